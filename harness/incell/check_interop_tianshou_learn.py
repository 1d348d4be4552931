"""Let Tianshou learn: DQN by its procedural API, as its own first tutorial has it."""

import importlib

from .cell_errors import library
from .cell_interop import import_trainer, make_environment
from .cell_learners import check_return, compare_parameters, copy_parameters, play_episode, seed_torch

STEPS, PER_COLLECT, BATCH, ENVIRONMENTS = 80, 10, 16, 2


def run(probe, facts):
    """Learn for one epoch on the CPU, which ends with its own test, and play an episode with the policy."""
    tianshou = import_trainer("tianshou", "tianshou")
    torch = seed_torch(probe, facts, tianshou)
    with library:
        vectors = importlib.import_module("tianshou.env")
        training, testing = (
            vectors.DummyVectorEnv([lambda: make_environment(probe) for _ in range(ENVIRONMENTS)]) for _ in range(2)
        )
        env = make_environment(probe)
        common = importlib.import_module("tianshou.utils.net.common")
        shape, actions = env.observation_space.shape, env.action_space.n
        network = common.Net(state_shape=shape, action_shape=actions, hidden_sizes=[32])
        before = copy_parameters(network)
        learn = _learn_by_algorithm if _has("tianshou.algorithm") else _learn_by_policy
        policy, best = learn(torch, env.action_space, network, training, testing)
    compare_parameters(before, copy_parameters(network))
    check_return(float(best))
    facts["steps"] = STEPS
    data = importlib.import_module("tianshou.data")

    def act(observation):
        batch = data.Batch(obs=observation[None], info=data.Batch())
        with torch.no_grad():
            return int(policy(batch).act[0])

    play_episode(facts, env, act)


def _learn_by_algorithm(_torch, space, network, training, testing):
    """Learn by Tianshou 2, in which an algorithm has a policy and trains it."""
    dqn = importlib.import_module("tianshou.algorithm.modelfree.dqn")
    optim = importlib.import_module("tianshou.algorithm.optim")
    trainer = importlib.import_module("tianshou.trainer")
    policy = dqn.DiscreteQLearningPolicy(model=network, action_space=space, eps_training=0.1, eps_inference=0.0)
    algorithm = dqn.DQN(
        policy=policy,
        optim=optim.AdamOptimizerFactory(lr=1e-3),
        gamma=0.9,
        n_step_return_horizon=3,
        target_update_freq=20,
    )
    collectors = _collectors(algorithm, training, testing)
    result = algorithm.run_training(
        trainer.OffPolicyTrainerParams(
            training_collector=collectors[0],
            test_collector=collectors[1],
            max_epochs=1,
            epoch_num_steps=STEPS,
            collection_step_num_env_steps=PER_COLLECT,
            test_step_num_episodes=ENVIRONMENTS,
            batch_size=BATCH,
            update_step_num_gradient_steps_per_sample=1 / PER_COLLECT,
            test_in_training=False,
        )
    )
    return policy, result.best_reward


def _learn_by_policy(torch, space, network, training, testing):
    """Learn by Tianshou 0.5 to 1, in which a policy has an optimizer and a trainer trains it."""
    policies = importlib.import_module("tianshou.policy")
    trainers = importlib.import_module("tianshou.trainer")
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    numbers = {"discount_factor": 0.9, "estimation_step": 3, "target_update_freq": 20}
    if hasattr(trainers, "offpolicy_trainer"):
        policy = policies.DQNPolicy(network, optimizer, **numbers)
    else:
        policy = policies.DQNPolicy(model=network, optim=optimizer, action_space=space, **numbers)
    collectors = _collectors(policy, training, testing)
    policy.set_eps(0.1)
    options = {
        "max_epoch": 1,
        "step_per_epoch": STEPS,
        "step_per_collect": PER_COLLECT,
        "episode_per_test": ENVIRONMENTS,
        "batch_size": BATCH,
        "update_per_step": 1 / PER_COLLECT,
    }
    if hasattr(trainers, "offpolicy_trainer"):
        result = trainers.offpolicy_trainer(policy, *collectors, **options)
        return policy, result["best_reward"]
    result = trainers.OffpolicyTrainer(
        policy=policy, train_collector=collectors[0], test_collector=collectors[1], **options
    ).run()
    return policy, result.best_reward


def _collectors(learner, training, testing):
    """Return a collector that fills a buffer, and one for tests."""
    data = importlib.import_module("tianshou.data")
    buffer = data.VectorReplayBuffer(STEPS * 2, ENVIRONMENTS)
    return data.Collector(learner, training, buffer, exploration_noise=True), data.Collector(learner, testing)


def _has(name):
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        return False
    return True
