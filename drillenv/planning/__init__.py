"""What to record: the settings that let a diagnosis tell most mechanisms apart.

plan.py          a plan, from the candidates to the sheet
information.py   what a recording at a setting says of each mechanism
signatures.py    how a mechanism shows in the forces of a motion
choice.py        the criterion, and the choice of settings by it
sheet.py         the sheet for the lab
"""
