"""Define adapters: one API, and one environment of it as the phases drive it.

`API` in each `api_NAME.py` is an `Adapter`. These files are loaded before the libraries under test: whatever a library
may have forgotten to import itself (numpy, too) is imported inside functions.
"""

from .cell_errors import library, skip
from .cell_observed import place
from .cell_values import finite, flag, scalar


class Adapter:
    """One API: which modules it needs, and how its environments are made."""

    imports = ()
    """Modules to import before anything else."""

    one_reward = False
    """True where a batch has room for one number only as the reward of each environment."""

    def modules(self, case):
        """Return the names of modules to import first for a case."""
        return list(self.imports)

    def knows(self, case):
        """Return whether the environment of a case can be made without importing the modules that may register it."""
        names = self.names()
        return names is None or self.named(case) in names

    def names(self):
        """Return the names of all environments as ids have them; None if they cannot be listed."""
        return

    def named(self, case):
        """Return the name of a case's environment, without the API's name before it."""
        prefix, colon, rest = (case["env"] or "").partition(":")
        return rest if colon and prefix == case["api"] else case["env"]

    def versions(self, case):
        """Return the names that exist for a case's environment in any version."""
        stem = _stem(self.named(case).rpartition(":")[2])
        return [one for one in self.names() or () if _stem(one) == stem]

    def nearest(self, case):
        """Return the names most like that of a case, the nearest first; None if they cannot be listed."""
        import difflib

        names = self.names()
        if names is None:
            return None
        name = self.named(case).rpartition(":")[2]
        stems = {}
        for one in names:
            stems.setdefault(_stem(one), []).append(one)
        found = [_stem(name)] if _stem(name) in stems else difflib.get_close_matches(_stem(name), stems, cutoff=0.7)
        return [stems[stem][-1] for stem in found]

    def make(self, case, tell, draw=False):
        """Make the environment of a case, one that draws if asked: an `Environment`."""
        raise NotImplementedError

    def bare(self, case):
        """Make the library's own object, for its vector environments: what a worker does."""
        skip("skip.no_batches")

    def make_vector(self, makers, way, tell):
        """Make one environment of several: `way` is None in this process, or arguments, with a `context` in workers.

        Its `processes` are the workers.
        """
        skip("skip.no_batches")

    def autoreset_modes(self):
        """Say in which ways an environment of several begins episodes anew: arguments that choose each, by its name."""
        skip("skip.no_autoreset")

    def limited(self, raw, steps):
        """Wrap the library's own object so that its episodes are no longer than this."""
        raise NotImplementedError

    def check_env(self, case):
        """Run the library's own checker."""
        skip("skip.no_checker")

    def picture(self, case):
        """Return two colours, `above` and `below`, of a right picture of a scene that the adapter itself brings."""
        return

    def declares_pictures(self, case):
        """Return whether the environment says that it can be drawn; yes where it cannot be asked."""
        return True


def _stem(name):
    """Return a name without its version."""
    return name.rpartition("-v")[0] or name


class Environment:
    """One environment, driven as a user would; what comes back is examined.

    An adapter without spaces to examine says how it is driven: `begin`, `advance`, `draw`. `tell` takes a kind (`type`,
    `space`), a code and data of something that does not stop a user's loop.
    """

    processes = ()
    shape = ()
    """Of rewards and flags: () of one environment, (n,) of a simulation of n worlds."""

    seen_from = None
    """The camera of the last picture, where the adapter places it: `view` and `lens`, matrices of 16 numbers."""

    get_state = None
    """Where the state can be had: a method that returns it, and `set_state` that takes it back."""

    def __init__(self, tell):
        self.tell = tell

    def begin(self, seed):
        """Start an episode, with this seed unless it is None, and return the observation."""
        raise NotImplementedError

    def advance(self, action):
        """Make one step and return (observation, reward, terminated, truncated)."""
        raise NotImplementedError

    def draw(self):
        """Return a picture: an array (height, width, 3) of uint8."""
        skip("skip.no_pictures")

    def where_drawn(self, ask):
        """Call a function in the thread that draws, with the context current that drew last, and return its result."""
        return ask()

    def reset(self, seed=None):
        """Start an episode and return the observation, which has to be finite."""
        with library:
            observation = self.begin(seed)
        finite(observation, place("an observation", "reset()"))
        return observation

    def step(self, action):
        """Make one step and return (observation, reward, terminated, truncated), all of them usable."""
        with library:
            observation, reward, terminated, truncated = self.advance(action)
        finite(observation, place("an observation", "step()"))
        scalar(reward, place("a reward", "step()"), self.shape)
        flag("terminated", terminated, self.tell, self.shape)
        flag("truncated", truncated, self.tell, self.shape)
        return observation, reward, terminated, truncated

    def render(self):
        """Return a picture of the present state, not examined yet."""
        with library:
            return self.draw()

    def rewards(self):
        """Return how many numbers a reward has: one, unless something is declared."""
        return 1

    def seed_actions(self, seed):
        """Make `action` give the same actions again."""

    def action(self):
        """Return a valid action."""
        return

    def describe(self):
        """Return the promises of the environment as text, by name."""
        return {}

    def close(self):
        """Let go of everything."""
