"""SPlisHSPlasH in a process of its own, `python splishsplash_process.py FOLDER`, independent of the lab.

FOLDER contains its scene.json. Commands come on standard input, one per line, and are answered by a line of JSON on the
original standard output; arrays go through files of FOLDER, in the order of `id`:

- `load`: positions and velocities (particles, 3) of load.npz, at time 0 (its own `reset` loses the neighbours)
- `advance SECONDS`: in its own steps, the last one shortened to end there
- `read`: writes read.npz

Without a window only `runSimulation` initialises it, which also does a step, so every run begins with `load`.
"""

import json
import os
import sys
import time

import numpy as np

WARM = {"p / rho^2", "p_v / rho^2"}  # the initial values of its solvers
LEAST = 1e-4  # of the requested time: the resolution of its clock, in float32


def main() -> None:
    """Serve commands until standard input ends."""
    folder = sys.argv[1]
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # redirect its own output to standard error
    import pysplishsplash as splish

    base = splish.Exec.SimulatorBase()
    base.init(
        sceneFile=os.path.join(folder, "scene.json"), outputDir=os.path.join(folder, "out"), useCache=False,
        initialPause=False, useGui=False, stopAt=1e-9,
    )  # fmt: skip
    base.initSimulation()
    base.runSimulation()
    simulation, clock = splish.Simulation.getCurrent(), splish.TimeManager.getCurrent()
    fluid = simulation.getFluidModel(0)
    count = fluid.numActiveParticles()

    def array(name: str) -> np.ndarray:
        return np.asarray(fluid.getFieldBuffer(name))[:count]

    def reply(**what: object) -> None:
        answers.write(json.dumps(what) + "\n")
        answers.flush()

    first_step, end = clock.getTimeStepSize(), clock.getTime()
    reply(particles=count, volume=fluid.getVolume(0))
    for line in sys.stdin:
        words = line.split()
        if words[0] == "load":
            start, order = np.load(os.path.join(folder, "load.npz")), array("id").ravel()
            for name in {field.name for field in fluid.getFields()} & WARM:
                array(name)[...] = 0.0
            array("position")[...] = start["position"][order]
            array("velocity")[...] = start["velocity"][order]
            clock.setTime(0.0)
            end = 0.0
            clock.setTimeStepSize(first_step)
            reply()
        elif words[0] == "advance":
            begin, asked, steps = time.perf_counter(), float(words[1]), 0
            end += asked
            while (left := end - clock.getTime()) > LEAST * asked:
                cfl_step = clock.getTimeStepSize()
                clock.setTimeStepSize(min(cfl_step, left))
                simulation.getTimeStep().step()
                steps += 1
                if cfl_step > left:  # a shortened step does not determine the next one
                    clock.setTimeStepSize(cfl_step)
            reply(seconds=time.perf_counter() - begin, steps=steps)
        elif words[0] == "read":
            back = np.argsort(array("id").ravel())
            np.savez(
                os.path.join(folder, "read.npz"), position=array("position")[back], velocity=array("velocity")[back]
            )
            reply()


if __name__ == "__main__":
    main()
