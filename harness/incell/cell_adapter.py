"""Define adapters: one API, and one environment of it as the phases drive it.

`API` in each `api_NAME.py` is an `Adapter`. These files are loaded before the libraries under test: whatever a library
may have forgotten to import itself (numpy, too) is imported inside functions.
"""

from .cell_callables import local_name
from .cell_errors import library, skip
from .cell_observation import place
from .cell_values import check_finite, check_flag, check_number


class Adapter:
    """One API: which modules it needs, and how its environments are made."""

    imports = ()
    """Modules to import before anything else."""

    single_reward = False
    """True where a batch has room for one number only as the reward of each environment."""

    def modules(self, case):
        """Return the names of modules to import first for a case."""
        return list(self.imports)

    def has_environment(self, case):
        """Return whether the environment of a case can be made without importing the modules that may register it."""
        names = self.environment_names()
        return names is None or self.local_name(case) in names

    def environment_names(self):
        """Return the names of all environments as ids have them; None if they cannot be listed."""
        return

    def local_name(self, case):
        """Return the name of a case's environment, without the API's name before it."""
        return local_name(case)

    def versions(self, case):
        """Return the names that exist for a case's environment in any version."""
        stem = _stem(self.local_name(case).rpartition(":")[2])
        return [name for name in self.environment_names() or () if _stem(name) == stem]

    def similar_names(self, case):
        """Return the names most like that of a case, the nearest first; None if they cannot be listed."""
        import difflib

        names = self.environment_names()
        if names is None:
            return None
        stem = _stem(self.local_name(case).rpartition(":")[2])
        latest = {_stem(name): name for name in names}
        stems = [stem] if stem in latest else difflib.get_close_matches(stem, latest, cutoff=0.7)
        return [latest[stem] for stem in stems]

    def make(self, case, report, draw=False):
        """Make the environment of a case, one that draws if requested: an `Environment`."""
        raise NotImplementedError

    def make_raw(self, case):
        """Make the library's own object, as the workers of its vector environments do."""
        skip("skip.no_batches")

    def make_vector(self, makers, options, report):
        """Make one environment of several, with the workers as its `processes`.

        `options` is None for environments in this process, else arguments, with a `context` for those in workers.
        """
        skip("skip.no_batches")

    def autoreset_modes(self):
        """Return the arguments of each autoreset mode of a batch, by the name of the mode."""
        skip("skip.no_autoreset")

    def limit_steps(self, raw, steps):
        """Wrap the library's own object so that its episodes are no longer than this."""
        raise NotImplementedError

    def check_env(self, case):
        """Run the library's own checker."""
        skip("skip.no_checker")

    def picture_colours(self, case):
        """Return two colours, `above` and `below`, of a right picture of a scene that the adapter itself brings."""
        return

    def declares_pictures(self, case):
        """Return whether the environment declares that it can be drawn; True where it cannot be asked."""
        return True


def _stem(name):
    """Return a name without its version."""
    return name.rpartition("-v")[0] or name


class Environment:
    """One environment, driven as a user would; what comes back is examined.

    An adapter without spaces to examine defines `begin`, `advance` and `draw`. `report` takes a kind (`type`, `space`),
    a code and data of something that does not stop a user's loop.
    """

    raw = None
    """The library's own object, where there is one; `close` closes it."""

    processes = ()
    shape = ()
    """Of rewards and flags: () of one environment, (n,) of a simulation of n worlds."""

    camera_matrices = None
    """The camera of the last picture, where the adapter places it: `view` and `lens`, matrices of 16 numbers."""

    get_state = None
    """Where the state can be had: a method that returns it, and `set_state` that takes it back."""

    def __init__(self, report):
        self.report = report

    def begin(self, seed):
        """Start an episode, with this seed unless it is None, and return the observation."""
        raise NotImplementedError

    def advance(self, action):
        """Make one step and return (observation, reward, terminated, truncated)."""
        raise NotImplementedError

    def draw(self):
        """Return a picture: an array (height, width, 3) of uint8."""
        skip("skip.no_pictures")

    def call_where_drawn(self, function):
        """Call a function in the thread that draws, with the context current that drew last, and return its result."""
        return function()

    def reset(self, seed=None):
        """Start an episode and return the observation, which has to be finite."""
        with library:
            observation = self.begin(seed)
        check_finite(observation, place("an observation", "reset()"))
        return observation

    def step(self, action):
        """Make one step and return (observation, reward, terminated, truncated), all of them usable."""
        with library:
            observation, reward, terminated, truncated = self.advance(action)
        check_finite(observation, place("an observation", "step()"))
        check_number(reward, place("a reward", "step()"), self.shape)
        check_flag("terminated", terminated, self.report, self.shape)
        check_flag("truncated", truncated, self.report, self.shape)
        return observation, reward, terminated, truncated

    def render(self):
        """Return a picture of the present state, not examined yet."""
        with library:
            return self.draw()

    def reward_size(self):
        """Return how many numbers a reward has: one, unless something is declared."""
        return 1

    def seed_actions(self, seed):
        """Seed the generator `random`, so that `action` gives the same actions again."""
        import numpy as np

        self.random = np.random.RandomState(seed)

    def action(self):
        """Return a valid action."""
        return

    def describe(self):
        """Return the promises of the environment as text, by name."""
        return {}

    def close(self):
        """Close the library's own object."""
        if self.raw is not None:
            self.raw.close()
