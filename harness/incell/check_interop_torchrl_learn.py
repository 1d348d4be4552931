"""Let TorchRL learn: a collector, a replay buffer, a DQN loss, and a rollout of the learned policy."""

import importlib

from .cell_errors import library
from .cell_interop import close, import_trainer, make_environment
from .cell_learners import LONGEST, check_count, check_return, compare_parameters, copy_parameters, seed_torch

FRAMES, BATCH = 96, 32


def run(probe, facts):
    """Learn from three batches on the CPU, and evaluate by a rollout."""
    torch = seed_torch(probe, facts, import_trainer("torchrl", "torchrl"))
    with library:
        parts = _Parts()
        env = parts.envs.GymWrapper(make_environment(probe), device="cpu")
        inputs, outputs = env.observation_spec["observation"].shape[-1], env.action_spec.space.n
        network = parts.modules.MLP(in_features=inputs, out_features=outputs, num_cells=[32])
        policy = parts.modules.QValueActor(network, in_keys=["observation"], spec=env.action_spec)
        greedy = parts.modules.EGreedyModule(env.action_spec, eps_init=0.5, eps_end=0.1, annealing_num_steps=FRAMES)
        explorer = parts.nn.TensorDictSequential(policy, greedy)
        collector = parts.collector(env, explorer, frames_per_batch=BATCH, total_frames=FRAMES, device="cpu")
        buffer = parts.data.ReplayBuffer(storage=parts.data.LazyTensorStorage(FRAMES), batch_size=BATCH)
        loss = parts.objectives.DQNLoss(policy, delay_value=True, action_space=env.action_spec)
        updater = parts.objectives.SoftUpdate(loss, eps=0.9)
        optimizer = torch.optim.Adam(loss.parameters(), lr=1e-3)
    before, frames = copy_parameters(network), 0
    try:
        with library:
            for batch in collector:
                frames += batch.numel()
                buffer.extend(batch.reshape(-1))
                loss(buffer.sample())["loss"].backward()
                optimizer.step()
                optimizer.zero_grad()
                updater.step()
    finally:
        with library:
            collector.shutdown()
    compare_parameters(before, copy_parameters(network))
    check_count(FRAMES, frames)
    facts["steps"] = frames
    _evaluate(probe, facts, parts, policy)


def _evaluate(probe, facts, parts, policy):
    """Roll the policy out without exploration."""
    with library:
        env = parts.envs.GymWrapper(make_environment(probe), device="cpu")
    try:
        with library, parts.exploration("DETERMINISTIC"):
            rollout = env.rollout(LONGEST, policy)
        check_return(float(rollout["next", "reward"].sum()))
        facts["evaluated"] = rollout.shape[-1]
    finally:
        close(env)


class _Parts:
    """The modules of TorchRL that a user imports."""

    def __init__(self):
        self.nn = importlib.import_module("tensordict.nn")
        for name in ("envs", "data", "modules", "objectives"):
            setattr(self, name, importlib.import_module("torchrl." + name))
        collectors = importlib.import_module("torchrl.collectors")
        # Releases after 0.11 have it under a shorter name; the older one is gone later.
        self.collector = getattr(collectors, "Collector", None) or collectors.SyncDataCollector

    def exploration(self, name):
        """Return the context in which the policy acts as this type of exploration has it."""
        utils = importlib.import_module("torchrl.envs.utils")
        return utils.set_exploration_type(getattr(utils.ExplorationType, name))
