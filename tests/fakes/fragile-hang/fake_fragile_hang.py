import time

import fake_healthy
import gymnasium


class FragileHang(fake_healthy.Healthy):
    def reset(self, *, seed=None, options=None):
        if options is not None:
            time.sleep(600)
        return super().reset(seed=seed)


gymnasium.register("FragileHang-v0", FragileHang)
