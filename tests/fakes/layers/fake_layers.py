import multiprocessing

import fake_healthy
import gymnasium
import numpy

VERSION = "@VERSION@"


class Layers(fake_healthy.Healthy):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        if VERSION == "1.0" and multiprocessing.parent_process():
            raise ValueError("XML Error: top-level default class 'main' cannot be renamed\n\nElement 'default', line 0")

    def render(self):
        frame = super().render()
        return numpy.zeros_like(frame) if VERSION == "2.0" else frame


gymnasium.register("Layers-v0", Layers)
