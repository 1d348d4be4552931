"""Let skrl learn: its wrapper, a memory, two models, PPO and the sequential trainer."""

import importlib

from .cell_errors import library
from .cell_interop import close, import_trainer, make_environment
from .cell_learners import compare_parameters, copy_parameters, play_episode, seed_torch

STEPS, ROLLOUT = 64, 32


def run(probe, facts):
    """Learn for two rounds on the CPU, evaluate by the trainer, and play an episode with the policy."""
    torch = seed_torch(probe, facts, import_trainer("skrl", "skrl"))
    with library:
        env = importlib.import_module("skrl.envs.wrappers.torch").wrap_env(make_environment(probe))
    try:
        with library:
            models = _models(torch, env)
            agent = _agent(env, models)
            trainer = importlib.import_module("skrl.trainers.torch").SequentialTrainer(
                env=env, agents=agent, cfg={"timesteps": STEPS, "headless": True, "disable_progressbar": True}
            )
        before = copy_parameters(models["policy"])
        with library:
            trainer.train()
            trainer.eval()
        compare_parameters(before, copy_parameters(models["policy"]))
        facts["steps"] = STEPS
    finally:
        close(env)

    def act(observation):
        with torch.no_grad():
            return int(models["policy"].net(torch.tensor(observation)[None]).argmax())

    play_episode(facts, make_environment(probe), act)


def _models(torch, env):
    """Return a policy and a value function, written as skrl documents it for its release."""
    library_models = importlib.import_module("skrl.models.torch")
    keyed = importlib.import_module("skrl").__version__.partition(".")[0] >= "2"
    spaces = env.observation_space, env.action_space
    key = "observations" if keyed else "states"

    def model(mixin, outputs):
        class Network(mixin, library_models.Model):
            def __init__(self):
                if keyed:
                    library_models.Model.__init__(
                        self, observation_space=spaces[0], action_space=spaces[1], device="cpu"
                    )
                else:
                    library_models.Model.__init__(self, *spaces, "cpu")
                mixin.__init__(self)
                self.net = torch.nn.Sequential(
                    torch.nn.Linear(self.num_observations, 32), torch.nn.ELU(), torch.nn.Linear(32, outputs)
                )

            def compute(self, inputs, role):
                return self.net(inputs[key]), {}

        return Network()

    return {
        "policy": model(library_models.CategoricalMixin, int(spaces[1].n)),
        "value": model(library_models.DeterministicMixin, 1),
    }


def _agent(env, models):
    """Return a PPO agent that writes no files."""
    ppo = importlib.import_module("skrl.agents.torch.ppo").PPO
    memory = importlib.import_module("skrl.memories.torch").RandomMemory
    return ppo(
        models=models,
        memory=memory(memory_size=ROLLOUT, num_envs=env.num_envs, device="cpu"),
        cfg={
            "rollouts": ROLLOUT,
            "learning_epochs": 1,
            "mini_batches": 1,
            "experiment": _nothing_written(),
        },
        observation_space=env.observation_space,
        action_space=env.action_space,
        device="cpu",
    )


def _nothing_written():
    """Return settings by which nothing is written: a dict, or what skrl 2 has instead."""
    settings = {"directory": "", "experiment_name": "", "write_interval": 0, "checkpoint_interval": 0}
    kind = getattr(importlib.import_module("skrl.agents.torch.base"), "ExperimentCfg", None)
    return kind(**settings) if kind else dict(settings, wandb=False, store_separately=False)
