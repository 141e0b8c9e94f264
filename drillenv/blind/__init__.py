"""The blind trial: a rig of its own conceals physics, and the diagnosis has to find it.

This room shares no equation, table or integrator with ``drillenv.dynamics`` and ``drillenv.diagnosis`` (a test walks
its imports). It reaches the diagnosis by the command ``drillenv diagnose`` only, run on campaign folders.

    laws          constitutive equations, one function each
    rig           the equations of motion, integrated at 200 kHz with located switches
    sensors       transducers, cables and the data logger
    body          a single body that conceals physics of its own, with its catalogue in body_mechanisms
    mechanisms    the catalogue: for each mechanism the equations it may follow, and how strong they are drawn
    campaigns     groups of campaigns, drawn from a seed, and their answers
    seal          the answers, sealed with SHA-256
    confined      the process in which one diagnosis runs
    trial         the whole trial, resumable
    curves        what was missing as a function of its argument, as the marking compares it
    marking       the marks, by the rules of docs/trial/rules.md
    detection     the share of campaigns in which a mechanism is named against its strength
    page          trial.html, with the figures of drawing
"""
