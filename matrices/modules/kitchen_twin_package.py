"""Stands in for `diffusion_policy`: every module of it that is asked for is the twin."""

import sys

import kitchen_twin

for name in (
    "env",
    "env.kitchen",
    "env.kitchen.v0",
    "env.kitchen.kitchen_lowdim_wrapper",
    "gym_util",
    "gym_util.async_vector_env",
    "gym_util.sync_vector_env",
    "gym_util.multistep_wrapper",
    "gym_util.video_recording_wrapper",
):
    sys.modules["{}.{}".format(__name__, name)] = kitchen_twin
