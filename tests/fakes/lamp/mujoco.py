"""Stands in the place of MuJoCo's bindings: a scene has a camera, lights and geometries, and is drawn from them."""

import numpy


class MjModel:
    pass


class Part:
    def __init__(self, **values):
        self.__dict__.update(values)


def vector(*values):
    return numpy.array(values, numpy.float32)


class MjvScene:
    nlight = ngeom = 1
    flags = numpy.zeros(10, numpy.uint8)

    def __init__(self, height, brightness, colour):
        eye = {"pos": vector(0, -3, height), "forward": vector(0, 1, 0), "up": vector(0, 0, 1)}
        lens = {"frustum_top": 0.5, "frustum_bottom": -0.5, "frustum_near": 1.0}
        self.camera = [Part(**eye, **lens)] * 2
        self.lights = [Part(headlight=0, pos=vector(0, 0, 4), dir=vector(0, 0, -1), diffuse=vector(brightness, 1, 1))]
        looks = {"rgba": vector(*colour, 1), "emission": 0.0}
        self.geoms = [Part(objtype=5, objid=0, type=2, size=vector(1, 1, 1), pos=vector(0, 0, 0), **looks)]


def mjv_updateScene(model, data, opt, pert, cam, catmask, scn):
    scn.geoms[0].pos[0] = data
