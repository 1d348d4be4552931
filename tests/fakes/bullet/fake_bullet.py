import gymnasium
import numpy

GRAVITY = 9.81 * (1.001 if "@VERSION@" == "2.0" else 1.0)
STILL = (0.0, 0.0, 0.0, 1.0)
FLOOR, BALL = 0, 1


class Client:
    made = 0

    def __init__(self):
        self.order = Client.made if "@VERSION@" == "4.0" else 0
        Client.made += 1
        self.bases = {FLOOR: ((0.0, 0.0, 0.0), STILL), BALL: ((0.0, 0.0, 0.0), STILL)}
        self.place, self.speed, self.push, self.kept = 0.3, 0.0, 0.0, 0.0
        self.steps = 0

    def getNumBodies(self):
        return 2

    def getBodyUniqueId(self, number):
        return number

    def getNumJoints(self, body):
        return body

    def getJointInfo(self, body, joint):
        return (joint, b"slide", 1, 0, 0, 0, 0.0, 0.0, -0.2, 1.0)

    def getDynamicsInfo(self, body, link):
        return (0.0,)

    def getBasePositionAndOrientation(self, body):
        return self.bases[body]

    def resetBasePositionAndOrientation(self, body, place, turn):
        self.bases[body] = (tuple(place), tuple(turn))

    def getJointState(self, body, joint):
        return self.place, self.speed

    def resetJointState(self, body, joint, place, speed):
        self.place, self.speed = place, speed

    def depth(self):
        return self.bases[FLOOR][0][2] - self.bases[BALL][0][2] - self.place

    def performCollisionDetection(self):
        pass

    def getContactPoints(self):
        return [(0, FLOOR, BALL, -1, 0, 0, 0, 0, -self.depth())] if self.depth() > 0 else []

    def stepSimulation(self):
        self.kept = 0.9 * self.kept + 400.0 * self.depth() if self.depth() > 0 else 0.0
        self.steps += 1
        if "@VERSION@" == "3.0" and self.depth() > 0.15:
            self.kept += self.steps
        self.speed += 0.01 * (self.push + self.kept - GRAVITY - 1e-3 * self.order)
        self.place += 0.01 * self.speed


class Slide(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1000, 1000, (2,), numpy.float64)
    action_space = gymnasium.spaces.Box(-1, 1, (1,), numpy.float32)

    def __init__(self):
        self._p = Client()

    def seen(self):
        return numpy.array([self._p.place, self._p.speed])

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._p.place, self._p.speed = self.np_random.uniform(0, 1), 0.0
        return self.seen(), {}

    def step(self, action):
        self._p.push = 5.0 * float(action[0])
        self._p.stepSimulation()
        return self.seen(), self._p.place, False, False, {}


gymnasium.register("Slide-v0", Slide)
