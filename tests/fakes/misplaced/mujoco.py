import enum

import numpy


class mjtObj(enum.IntEnum):
    mjOBJ_BODY = 1
    mjOBJ_JOINT = 3


class mjtSolver(enum.IntEnum):
    mjSOL_NEWTON = 2


class Options:
    solver = mjtSolver.mjSOL_NEWTON


class MjModel:
    opt = Options()
    nbody, njnt, ngeom, nu, nq, nv = 1, 2, 0, 0, 2, 2
    jnt_qposadr = numpy.array([0, 1])


class MjData:
    def __init__(self, model):
        self.qpos = numpy.zeros(model.nq)


def mj_step(m, d, nstep=1):
    d.qpos += 0.001 * nstep


def mj_id2name(m, kind, number):
    return "base:{}".format(number)
