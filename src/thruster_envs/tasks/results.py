"""What a step came to, copied out of a task's arrays by one compiled pass into arrays of its own."""

from thruster_envs.kernels import kernel


@kernel
def write_results(outcome, truth, begins, steps, limit, results):
    """Write the results of all worlds, and count the worlds whose episode is over.

    Args:
        outcome: A tuple of an :class:`~thruster_envs.tasks.contract.Outcome`.
        truth: A tuple of a :class:`~thruster_envs.tasks.contract.Truth`.
        begins: (worlds,), worlds that have just begun an episode: terms and cost are 0 in them, nothing is
            over.
        steps: (worlds,), steps of the episodes.
        limit: Steps after which an episode is cut.
        results: Three arrays, filled. Numbers, (terms + 4, agents, worlds): the terms, then cost, fuel,
            score, and the sum of the terms. Flags, (2, agents, worlds) bool: success, twice. Ends, (2,
            worlds) bool: whether an episode has come to its own end, and whether it is cut.
    """
    (terms, cost, over), (fuel, score, success), (numbers, flags, ends) = outcome, truth, results
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
