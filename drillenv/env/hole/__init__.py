"""Drilling a hole as it is paid for: ``drillenv/DrillBit-v0``.

- :mod:`.bit`: wear, blunting and breakage of the bit;
- :mod:`.shaker`: heat of the coil, power of the amplifier, resonance of the frame;
- :mod:`.costs`: what time, bits and energy cost, and what a metre earns;
- :mod:`.episodes`: a hole before it is drilled: layers, frame, strengths of the bits;
- :mod:`.batch`: a step of many rigs; :mod:`.envs`: the Gymnasium environments.
"""
