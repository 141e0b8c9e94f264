"""Constitutive laws: the places where one may act, and laws as tables and as measured curves."""
