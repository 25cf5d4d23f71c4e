"""A contributor's integrator: v' = v + a dt, p' = p + dt (v + v') / 2, exact for a constant acceleration; without a damper it
gains energy at every step size.

Prints a line of JSON for each run: how far particles fell [m], and whether its bits are the CPU's. See test_toys.py.
"""

import json

from softlab.model.base.variant import formula
from softlab.model.core.integrators import INTEGRATORS, Integrator
from softlab.model.tables.method import Method

G, DT, STEPS = 8.0, 0.0078125, 6
NAME = "mean-velocity"


@formula
def mean_velocity(position, velocity, acceleration, dt, half_dt_squared):
    new_velocity = velocity + acceleration * dt
    return position + 0.5 * dt * (velocity + new_velocity), new_velocity


def limit(w, gamma):
    """det = 1 - dt gamma + dt^2 w^2 / 2 <= 1 and dt gamma < 2, of the step's matrix for x'' = -w^2 x - gamma x'."""
    return min(2 / gamma, 2 * gamma / w**2 if w else 2 / gamma) if gamma else 0.0 if w else float("inf")


def main() -> None:
    INTEGRATORS[NAME] = Integrator(NAME, 1, 1, limit, "drifts with the mean velocity", 6, mean_velocity)
    Method.model_fields["integrator"].annotation = str  # in a checkout: IntegratorName
    Method.model_rebuild(force=True)
    from toy_force import runs

    falling = {"gravity": {"acceleration": G}, "method": {"dt": DT, "integrator": NAME}}
    sheet, soft = {"rows": 4, "columns": 5, "spacing": 0.5, "pinned": "none"}, {"coefficient": 0.5}
    for tables in (
        {"cloth": sheet, **falling},
        {"grid": sheet, "springs": {"rest_length": 0.4}, "damping": soft, **falling},
    ):
        for simulation, run, same in runs(tables):
            before = simulation.read("position")
            simulation.advance(STEPS)
            after = simulation.read("position")
            fallen = float((before - after)[:, 1].mean())
            print(json.dumps({"run": run, "springs": "springs" in tables, "fallen": fallen, "same": same(after)}))


if __name__ == "__main__":
    main()
