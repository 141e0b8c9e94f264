"""Controllers of the rig, one file each, with one interface: reset(seed) and act(observation, info) -> action."""
