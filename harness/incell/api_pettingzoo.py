"""Drive PettingZoo: `pettingzoo:classic/rps_v2`; agents act at once where the module offers that.

What follows is a module below `pettingzoo`; with `aec:` before it, agents take turns. Every agent is examined by its
own spaces.
"""

import importlib
import os
import re
import sys

from .cell_adapter import Adapter, Environment
from .cell_callables import local_name, takes_argument, user_callable
from .cell_errors import library, skip, violate
from .cell_observation import place
from .cell_values import Examiner, check_flag, check_number, describe_value

PACKAGES = {"pettingzoo": "pettingzoo"}
IDS = r"(aec:)?[a-z]+/\w+[_-]v\d+"
EXAMPLE = "pettingzoo:classic/rps_v2"

TURNS = "aec:"
"""The prefix of a module whose agents take turns."""

FIVE = ("observations", "rewards", "terminations", "truncations", "infos")

CYCLES = 20
"""How long the library's own test goes on."""


class PettingZoo(Adapter):
    """The calls of a user: `module.parallel_env()` or `module.env()`, in a loop over agents."""

    imports = ("pettingzoo",)

    def modules(self, case):
        """Return the library, and the module of the environment."""
        factory = user_callable(case)
        module = factory.module if factory else _module(case)
        return [*self.imports, *([module] if factory or self.has_environment(case) else [])]

    def has_environment(self, case):
        """Return whether PettingZoo has the module, or it is a callable of the user's."""
        name = _module(case).partition(".")[2].replace(".", "/")
        return user_callable(case) is not None or name in self.environment_names()

    def environment_names(self):
        """Return all modules of environments, as `classic/rps_v2`."""
        return sorted(_modules())

    def make(self, case, report, draw=False):
        """Make the environment of a case."""
        with library:
            raw = self.make_raw(case, **({"render_mode": "rgb_array"} if draw else {}))
        return (TurnsGroup if hasattr(raw, "agent_iter") else ParallelGroup)(raw, report)

    def make_raw(self, case, **more):
        """Make the library's own object."""
        options = dict(case["kwargs"], **more)
        factory = user_callable(case)
        if factory:
            return factory.make(options)
        module = importlib.import_module(_module(case))
        turns = local_name(case).startswith(TURNS) or not hasattr(module, "parallel_env")
        return (module.env if turns else module.parallel_env)(**options)

    def make_vector(self, makers, options, report):
        """Skip: environments in batches are those of SuperSuit, another library."""
        skip("pettingzoo.no_batches")

    def check_env(self, case):
        """Run the library's own test."""
        with library:
            raw = self.make_raw(case)
            test = importlib.import_module("pettingzoo.test")
            if hasattr(raw, "agent_iter"):
                test.api_test(raw, num_cycles=CYCLES)
            else:
                test.parallel_api_test(raw, num_cycles=CYCLES)

    def declares_pictures(self, case):
        """Return whether the environment names the render mode rgb_array."""
        try:
            raw = self.make_raw(case)
            modes = raw.metadata.get("render_modes", ())
            raw.close()
        except Exception:
            return True
        return "rgb_array" in modes


def _module(case):
    name = local_name(case)
    name = name[len(TURNS) :] if name.startswith(TURNS) else name
    return "pettingzoo." + re.sub(r"-(v\d+)$", r"_\1", name).replace("/", ".")


def _modules():
    """Yield the modules of environments that lie in the library's folder, before it is imported."""
    for folder in sys.path:
        below = os.path.join(folder, "pettingzoo")
        for family in sorted(os.listdir(below)) if os.path.isdir(below) else ():
            place = os.path.join(below, family)
            for name in sorted(os.listdir(place)) if os.path.isdir(place) else ():
                if re.search(r"_v\d+\.py$", name):
                    yield family + "/" + name[: -len(".py")]


class Agent:
    """One agent of an environment, with its spaces as attributes."""

    def __init__(self, raw, name):
        self.name = name
        with library:
            self.observation_space = raw.observation_space(name)
            self.action_space = raw.action_space(name)


class Group(Environment):
    """Several agents; an episode is over when none of them is left."""

    def __init__(self, raw, report):
        super().__init__(report)
        self.raw = raw
        self.seed = 0
        self.agents = {}
        self.masks = {}

    def agent(self, name):
        """Return an agent and the examiner of its observations; both are made when it first appears."""
        if name not in self.agents:
            agent = Agent(self.raw, name)
            spaces = importlib.import_module(type(agent.observation_space).__module__.partition(".")[0] + ".spaces")
            examiner = Examiner(spaces, agent, self.report)
            self.agents[name] = agent, examiner
            self._seed(agent)
        return self.agents[name]

    def _seed(self, agent):
        with library:
            agent.action_space.seed(self.seed + sum(bytearray(str(agent.name).encode("utf-8"))))

    def examine(self, call, name, observation, info):
        """Examine the observation of an agent, and keep the mask of its allowed actions."""
        call = "{} of {}".format(call, name)
        examiner = self.agent(name)[1]
        examiner.info(call, info)
        examiner.observation(call, observation)
        masks = [
            part["action_mask"] for part in (observation, info) if isinstance(part, dict) and "action_mask" in part
        ]
        self.masks[name] = masks[0] if masks else None

    def draw_action(self, name):
        """Sample the action space of an agent, among its allowed actions."""
        space, mask = self.agent(name)[0].action_space, self.masks.get(name)
        with library:
            return space.sample() if mask is None else space.sample(mask)

    def seed_actions(self, seed):
        """Seed the action spaces, each in its own way."""
        self.seed = seed
        for agent, _ in self.agents.values():
            self._seed(agent)

    def draw(self):
        """Return the result of render()."""
        return self.raw.render()

    def describe(self):
        """Return the spaces by agent."""
        spaces = {}
        for kind in ("observation_space", "action_space"):
            spaces[kind] = str({name: str(getattr(agent, kind)) for name, (agent, _) in self.agents.items()})[:500]
        return spaces


class ParallelGroup(Group):
    """All agents act at once: everything comes by agent."""

    def reset(self, seed=None):
        """Start an episode and return the observations by agent."""
        with library:
            result = self.raw.reset(seed=seed)
            alone = takes_argument(self.raw.reset, "return_info")  # until 1.22 the observations, unless told otherwise
        if alone:
            result = result, {}
        elif not isinstance(result, tuple) or len(result) != 2:
            violate("call.result", call="reset()", got=describe_value(result), promised="(observations, infos)")
        observations, infos = result
        self._by_agent("reset()", "observations", observations, self.raw.agents)
        for name in self.raw.agents:
            self.examine("reset()", name, observations[name], _agent_info(infos, name))
        return dict(observations)

    def step(self, action):
        """Make one step: observations and rewards by agent, and whether all have ended, or all but those cut short."""
        with library:
            before = list(self.raw.agents)
            result = self.raw.step(action)
        if not isinstance(result, tuple) or len(result) != 5:
            violate("call.result", call="step()", got=describe_value(result), promised="({})".format(", ".join(FIVE)))
        for name, part in zip(FIVE[:4], result):
            self._by_agent("step()", name, part, before)
        observations, rewards, terminations, truncations, infos = result
        for name in before:
            self.examine("step()", name, observations[name], _agent_info(infos, name))
            check_number(rewards[name], place("a reward of {}".format(name), "step()"))
            check_flag("the termination of {}".format(name), terminations[name], self.report)
            check_flag("the truncation of {}".format(name), truncations[name], self.report)
        over = not self.raw.agents
        ended = over and all(terminations.values())
        return dict(observations), dict(rewards), ended, over and not ended

    def _by_agent(self, call, what, part, names):
        if not isinstance(part, dict):
            violate("pettingzoo.not_by_agent", call=call, what=what, got=describe_value(part))
        missing = [name for name in names if name not in part]
        if missing:
            violate("pettingzoo.agents_missing", call=call, what=what, missing=", ".join(map(str, missing)))

    def action(self):
        """Draw an action for each agent."""
        return {name: self.draw_action(name) for name in self.raw.agents}


class TurnsGroup(Group):
    """Agents act one after the other; a step is the turn of one of them."""

    def reset(self, seed=None):
        """Start an episode and return the observation of the first agent."""
        with library:
            self.raw.reset(seed=seed)
        return self._last("reset()")[0]

    def step(self, action):
        """Let an agent act; return observation and rewards of the next one, and whether no agent is left.

        Those whose episode has ended are told so in their turn, and do nothing in it.
        """
        seen, rewards, cut = {}, {}, False
        while True:
            with library:
                self.raw.step(action)
                over = not self.raw.agents
            if over:
                return seen, rewards, not cut, cut
            observation, reward, terminated, truncated = self._last("step()")
            seen.update(observation)
            rewards.update(reward)
            if not terminated and not truncated:
                return seen, rewards, False, False
            action, cut = None, cut or not terminated

    def _last(self, call):
        with library:
            name = self.raw.agent_selection
            result = self.raw.last()
        if not isinstance(result, tuple) or len(result) != 5:
            promised = "(observation, reward, termination, truncation, info)"
            violate("call.result", call="last() after {}".format(call), got=describe_value(result), promised=promised)
        observation, reward, terminated, truncated, info = result
        self.examine(call, name, observation, info)
        check_number(reward, place("a reward of {}".format(name), "last()"))
        check_flag("the termination of {}".format(name), terminated, self.report)
        check_flag("the truncation of {}".format(name), truncated, self.report)
        return {str(name): observation}, {str(name): reward}, terminated, truncated

    def action(self):
        """Draw an action for the agent whose turn it is."""
        return self.draw_action(self.raw.agent_selection)


def _agent_info(infos, name):
    return infos.get(name, {}) if isinstance(infos, dict) else infos


API = PettingZoo()
