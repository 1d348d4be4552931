import os

import numpy

VERSION = "@VERSION@"


class World:
    def __init__(self, mass=1.0):
        self.mass = mass

    def restart(self, seed):
        if seed is not None:
            self.random = numpy.random.RandomState(seed)
        self.place, self.speed = self.random.uniform(0, 9, 2), numpy.zeros(2)
        return self.place.copy()

    def push(self, force):
        if VERSION == "2.0":
            os.write(2, b"[pointmass] push: no such force\n")
            raise TypeError("push() takes a vector since 2.0")
        self.speed[0] += force / self.mass
        self.place += 0.1 * self.speed
        return self.place.copy()

    def picture(self):
        frame = numpy.zeros((32, 64, 3), numpy.uint8)
        column = 8 + int(self.place[0]) % 40
        frame[12:20, column : column + 8] = 200, 60, 20
        return frame
