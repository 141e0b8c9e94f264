"""Controllers of ``drillenv/DrillBit-v0``, whose action has a fourth number: change the bit."""
