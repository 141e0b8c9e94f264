"""The hybrid engine: a smooth vector field, guards and reset maps, for a rig with laws at any place.

:mod:`~drillenv.dynamics.hybrid.run` is what a user calls. A model is made in ``model``; its rates stand in
``vector_field``, the integrator in ``runge_kutta``, guards and reset maps in ``events``. ``advance`` puts them
together, one step at a time, and ``sensitivity`` differentiates what it does.
"""
