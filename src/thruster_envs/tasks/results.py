"""What a step came to, copied out of a task's arrays by one compiled pass into arrays of its own."""

from thruster_envs.kernels import kernel


@kernel
def write_results(
    terms, cost, over, fuel, score, success, begins, steps, limit, numbers, flags, ends
):  # fmt: skip
    """Write the results of all worlds, and count the worlds whose episode is over.

    Args:
        terms: (worlds, agents, terms), terms of the reward.
        cost: (worlds, agents).
        over: (worlds,), not 0 where an episode has come to its own end.
        fuel: (worlds, agents).
        score: (worlds, agents).
        success: (worlds, agents), not 0 for True.
        begins: (worlds,), worlds that have just begun an episode: terms and cost are 0 in them, nothing is
            over.
        steps: (worlds,), steps of the episodes.
        limit: Steps after which an episode is cut.
        numbers: (terms + 4, agents, worlds), filled: the terms, then cost, fuel, score, and the sum of the
            terms.
        flags: (2, agents, worlds) bool, filled: success, twice.
        ends: (2, worlds) bool, filled: whether an episode has come to its own end, and whether it is cut.
    """
    number = terms.shape[2]
    count = 0
    for world in range(steps.shape[0]):
        running = not begins[world]
        ends[0, world] = running and over[world] != 0.0
        ends[1, world] = running and steps[world] >= limit
        if ends[0, world] or ends[1, world]:
            count += 1
        for agent in range(terms.shape[1]):
            reward = -0.0
            for k in range(number):
                term = terms[world, agent, k] if running else 0.0
                numbers[k, agent, world] = term
                reward += term
            numbers[number, agent, world] = cost[world, agent] if running else 0.0
            numbers[number + 1, agent, world] = fuel[world, agent]
            numbers[number + 2, agent, world] = score[world, agent]
            numbers[number + 3, agent, world] = reward
            flags[0, agent, world] = success[world, agent] != 0.0
            flags[1, agent, world] = success[world, agent] != 0.0
    return count
