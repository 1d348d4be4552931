import copy
import types

import numpy

F = numpy.float32
GRAVITY = F(9.81 * (1.01 if "@VERSION@" == "0.3" else 1.0))


class State(types.SimpleNamespace):
    def replace(self, **parts):
        return State(**{**vars(copy.copy(self)), **parts})


class Slider:
    action_size, observation_size, backend = 1, 2, "fake"
    dof = types.SimpleNamespace(limit=(numpy.array([-0.5]), numpy.array([1.0])))
    sys = types.SimpleNamespace(link_types="1", dof=dof)

    def pipeline_init(self, q, qd):
        return State(q=q, qd=qd, force=F(-30) * q - GRAVITY)

    def _state(self, pipeline):
        seen = numpy.concatenate([pipeline.q, pipeline.qd])
        return State(pipeline_state=pipeline, obs=seen, reward=-pipeline.q[0], done=F(0), info={})

    def reset(self, key):
        place = numpy.random.RandomState(key % 2**32).uniform(-1, 1, 1)
        return self._state(self.pipeline_init(place.astype(F), numpy.zeros(1, F)))

    def step(self, state, action):
        before = state.pipeline_state
        drag, push = F(-0.1) * before.qd, F(2) * action
        force = (push + drag) + before.force if "@VERSION@" == "0.2" else before.force + drag + push
        qd = before.qd + F(0.02) * force
        return self._state(self.pipeline_init(before.q + F(0.02) * qd, qd))


def get_environment(name, **options):
    return Slider()
