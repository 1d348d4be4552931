import os
import time

import fake_healthy
import gymnasium


class DoubleFork(fake_healthy.Healthy):
    def reset(self, **kwargs):
        child = os.fork()
        if child == 0:
            os.setsid()
            if os.fork() == 0:
                time.sleep(600)
            os._exit(0)
        os.waitpid(child, 0)
        return super().reset(**kwargs)


gymnasium.register("DoubleFork-v0", DoubleFork)
