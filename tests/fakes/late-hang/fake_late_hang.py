import threading

import fake_healthy
import gymnasium


class LateHang(fake_healthy.Healthy):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        threading.Thread(target=threading.Event().wait).start()


gymnasium.register("LateHang-v0", LateHang)
