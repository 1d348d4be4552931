import sys

import fake_healthy
import gymnasium


class SysExit(fake_healthy.Healthy):
    def __init__(self, **kwargs):
        sys.exit("no licence file")


gymnasium.register("SysExit-v0", SysExit)
