"""Gipps's model as an acceleration, to be judged: accpinn judge RECORDING --model docs/gipps.py.

A driver takes the speed at which one can still stop behind the vehicle ahead, should that brake,
and reaches it within the reaction time T; far from any vehicle the speed tends to V:

    v_safe = -bT + √(b²T² + b [2 (p - s₀) - vT + u²/b̂]),     dv/dt = min((v_safe - v)/T, free)
    free   = 2.5 a (1 - v/V) √(0.025 + v/V)

with a [m/s²] the largest acceleration, b [m/s²] the braking that the driver is willing to apply, b̂
what is expected of the vehicle ahead, and s₀ [m] the gap at standstill. In place of the minimum and
of the root's domain stand smooth functions, as derivatives are taken by complex numbers. V is
hardly determined by cars that follow others, as v₀ of the IDM.

Source: P. G. Gipps, Transportation Research Part B 15 (1981) 105-111, equations 1 and 2.
"""

import accpinn


def smooth_minimum(x, y, xp):
    """The smaller of two accelerations, within 0.05 m/s²."""
    return 0.5 * (x + y - xp.sqrt((x - y) ** 2 + 0.01))


def acceleration(p, v, u, theta, xp):
    """In m/s² from a, b, b̂, T, s₀, V."""
    a, b, ahead, reaction, s0, fastest = theta[:6]
    squared = (b * reaction) ** 2 + b * (2.0 * (p - s0) - v * reaction + u * u / ahead)
    squared = 0.5 * (squared + xp.sqrt(squared * squared + 1.0))  # positive, else as it is
    braking = (xp.sqrt(squared) - b * reaction - v) / reaction
    pace = v / fastest
    room = 0.5 * (0.025 + pace + xp.sqrt((0.025 + pace) ** 2 + 1e-6))
    return smooth_minimum(braking, 2.5 * a * (1.0 - pace) * xp.sqrt(room), xp)


accpinn.register_model(
    accpinn.FollowingModel(
        "gipps",
        "Gipps",
        (  # name, symbol, unit, least, most, median and deviation of the prior's logarithm
            accpinn.Parameter("a", "a", "m/s²", 0.1, 20.0, 1.7, 0.6),
            accpinn.Parameter("b", "b", "m/s²", 0.2, 50.0, 3.0, 0.7),
            accpinn.Parameter("ahead", "b̂", "m/s²", 0.2, 50.0, 3.2, 0.7),
            accpinn.Parameter("T", "T", "s", 0.1, 5.0, 0.9, 0.4),
            accpinn.Parameter("s0", "s₀", "m", 0.1, 50.0, 4.0, 0.7),
            accpinn.Parameter("fastest", "V", "m/s", 5.0, 100.0, 40.0, 0.2),
        ),
        acceleration,
        formula="min[(v_safe − v)/T, 2.5 a (1 − v/V) √(0.025 + v/V)]",
    )
)
