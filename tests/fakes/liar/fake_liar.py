import json
import os

import fake_healthy
import gymnasium


class Liar(fake_healthy.Healthy):
    def step(self, action):
        for seq, check in enumerate(["single.loop", "vector.sync", "vector.async.fork", "render.rgb_array"]):
            start = {"kind": "start", "seq": 3 + 2 * seq, "pid": os.getpid(), "check": check}
            done = {**start, "kind": "check", "seq": start["seq"] + 1, "outcome": "passed", "seconds": 0.1}
            rest = {"raised": None, "observed": None, "workers": [], "facts": {}}
            print(json.dumps(start), json.dumps({**done, **rest}), sep="\n", flush=True)
        os._exit(0)


gymnasium.register("Liar-v0", Liar)
