"""Let a policy learn as CleanRL's `ppo.py` has it: one file, a SyncVectorEnv and a policy of torch."""

import importlib

from .cell_errors import library, violate
from .cell_interop import close, import_trainer, make_environment
from .cell_learners import compare_parameters, copy_parameters, play_episode, seed_torch

ENVIRONMENTS, STEPS, ROUNDS = 2, 64, 2
DISCOUNT, SMOOTHING, CLIP = 0.99, 0.95, 0.2


def run(probe, facts):
    """Learn for two rounds on the CPU, and play an episode; report what CleanRL's own loop would not log."""
    gym = import_trainer(probe.case["api"], probe.case["api"])
    import_trainer("torch", "torch")
    torch = seed_torch(probe, facts, gym)
    with library:
        wrap = importlib.import_module(gym.__name__ + ".wrappers").RecordEpisodeStatistics
        envs = gym.vector.SyncVectorEnv([lambda: wrap(make_environment(probe))] * ENVIRONMENTS)
    try:
        agent = _agent(torch, envs)
        before = copy_parameters(agent)
        ended, logged = _learn(torch, envs, agent, probe.case["seed"])
    finally:
        close(envs)
    compare_parameters(before, copy_parameters(agent))
    facts["steps"] = ENVIRONMENTS * STEPS * ROUNDS
    if not ended:
        violate("cleanrl.no_end", steps=facts["steps"])
    if not logged:
        probe.finding("interop.cleanrl.log", "cleanrl.no_return", episodes=ended)

    def act(observation):
        with torch.no_grad():
            return int(agent.actor(torch.Tensor(observation)).argmax())

    play_episode(facts, make_environment(probe), act)


def _agent(torch, envs):
    """Return a policy and a value function, of one hidden layer each."""

    def network(outputs):
        return torch.nn.Sequential(torch.nn.Linear(inputs, 32), torch.nn.Tanh(), torch.nn.Linear(32, outputs))

    inputs = int(envs.single_observation_space.shape[0])
    agent = torch.nn.Module()
    agent.actor, agent.critic = network(int(envs.single_action_space.n)), network(1)
    return agent


def _learn(torch, envs, agent, seed):
    """Learn; return how many episodes ended, and how many returns the loop that CleanRL documents would have logged."""
    import numpy as np

    optimizer = torch.optim.Adam(agent.parameters(), lr=2.5e-4, eps=1e-5)
    ended = logged = 0
    with library:
        observation, _ = envs.reset(seed=seed)
    observation, done = torch.Tensor(observation), torch.zeros(ENVIRONMENTS)
    for _ in range(ROUNDS):
        rows = []
        for _ in range(STEPS):
            with torch.no_grad():
                chances = torch.distributions.Categorical(logits=agent.actor(observation))
                action, value = chances.sample(), agent.critic(observation).flatten()
            with library:
                following, reward, terminations, truncations, infos = envs.step(action.cpu().numpy())
            ends = np.logical_or(terminations, truncations)
            ended, logged = ended + int(ends.sum()), logged + _count_returns(infos)
            rows.append(
                (observation, done, action, chances.log_prob(action), value, torch.tensor(reward).view(-1).float())
            )
            observation, done = torch.Tensor(following), torch.Tensor(ends)
        with torch.no_grad():
            following = agent.critic(observation).flatten()
        _update(torch, optimizer, agent, rows, done, following)
    return ended, logged


def _count_returns(infos):
    """Count the episodes that CleanRL's loop logs: it reads `final_info`, an array of one dict for each environment."""
    final = infos.get("final_info")
    if final is None or isinstance(final, dict):
        return 0
    return sum(1 for info in final if info and "episode" in info)


def _update(torch, optimizer, agent, rows, done, following):
    """Make one update by PPO's clipped objective."""
    observations, dones, actions, chances, values, rewards = (torch.stack(part) for part in zip(*rows))
    advantages, last = torch.zeros_like(rewards), 0.0
    for step in reversed(range(len(rows))):
        goes_on = 1.0 - (done if step == len(rows) - 1 else dones[step + 1])
        delta = rewards[step] + DISCOUNT * following * goes_on - values[step]
        advantages[step] = last = delta + DISCOUNT * SMOOTHING * goes_on * last
        following = values[step]
    returns = (advantages + values).flatten()
    advantages = advantages.flatten()
    advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    observations = observations.reshape((-1, *observations.shape[2:]))
    news = torch.distributions.Categorical(logits=agent.actor(observations))
    ratio = (news.log_prob(actions.flatten()) - chances.flatten()).exp()
    policy_loss = torch.max(-advantages * ratio, -advantages * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
    value_loss = 0.5 * ((agent.critic(observations).flatten() - returns) ** 2).mean()
    optimizer.zero_grad()
    (policy_loss + 0.5 * value_loss - 0.01 * news.entropy().mean()).backward()
    torch.nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
    optimizer.step()
