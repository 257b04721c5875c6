"""How fast walkers walk: whole runs of models beside the time that they simulate (some seconds).

Usage: python benchmarks/walkers.py

Processor time of `vlmb.simulate` with everything that it makes of a scene, from a file that is read already, in one thread: the
fastest of several runs. Real time over it is how many times faster than its clock a walker walks.
"""

from __future__ import annotations

from common import MODELS, interleaved, table, write_report

# isort: split
import vlmb

WALKERS = ("figure_walker", "figure_walker_hops", "compass_gait", "simplest_walker", "slip_walker", "slip_runner")


def main() -> None:
    """Run all walkers, write the report."""
    rows, found = [], {}
    for name in WALKERS:
        scene = vlmb.load_scene(MODELS / f"{name}.toml")
        run = vlmb.simulate(scene)
        seconds = interleaved({"run": lambda scene=scene: vlmb.simulate(scene)}, repeats=5, number=1)["run"]
        touches = sum(event.kind == "touch" for event in run.events)
        simulated, count, asked = float(run.t[-1]), len(run.mechanism.coordinate_names), run.stats["rhs_evaluations"]
        rows.append([name, count, f"{simulated:g}", touches, asked, f"{seconds:.3f}", f"{simulated / seconds:.0f}"])
        found[name] = {"seconds": seconds, "simulated": simulated, "touches": touches, "times_real_time": simulated / seconds}
    head = ["model", "coordinates", "simulated [s]", "touches", "right-hand sides", "processor time [s]", "times real time"]
    write_report("walkers", [str(__doc__).split("\n\n")[0].strip(), table(head, rows), str(__doc__).split("\n\n")[2]], found)


if __name__ == "__main__":
    main()
