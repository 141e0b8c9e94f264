"""The rig as Gymnasium environments: ``drillenv/Drill-v0``, ``drillenv/DrillLayers-v0``, ``drillenv/DrillHidden-v0``.

import gymnasium as gym
import drillenv

env = gym.make("drillenv/DrillLayers-v0")
envs = gym.make_vec("drillenv/DrillLayers-v0", 64, vectorization_mode="vector_entry_point")
"""
