"""Learning rate by step."""

import math

SCHEDULES = ("constant", "cosine")


def learning_rate_factor(
    step: int, *, steps: int, warmup: float, final: float, schedule: str
) -> float:
    """Factor of the learning rate before step `step` (from 0) of `steps`.

    `cosine`: linear from 0 over the share `warmup`, then half a cosine down to `final`
    (Loshchilov and Hutter, "SGDR", 2017). `constant`: 1 throughout, as the paper trained.
    """
    if schedule == "constant":
        return 1.0
    rise = max(1, round(steps * warmup))
    if step < rise:
        return (step + 1) / rise
    progress = min(1.0, (step - rise) / max(1, steps - rise))
    return final + (1.0 - final) * 0.5 * (1.0 + math.cos(math.pi * progress))
