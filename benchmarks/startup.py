"""Time of the import and of the first projection in a new process."""

import subprocess
import sys
import time
from statistics import median

from benchmarks.race import Race

CASES = (
    ("import omnisight, fresh process", "import omnisight", 0.25),
    ("omnisight --help, fresh process", "from omnisight.cli import main; main(['--help'])", 0.3),
    (
        "first project of a model, fresh process, warm cache",
        "import omnisight as om; om.model_class('{name}').example().project([[0.1, 0.2, 1.0]])",
        1.0,
    ),
)


def run() -> list[Race]:
    import omnisight as om

    races: list[Race] = []
    for work, code, limit in CASES:
        worst, name_of_worst = 0.0, ""
        for name in om.model_names() if "{name}" in code else ("",):
            command = [sys.executable, "-c", code.replace("{name}", name)]
            subprocess.run(command, capture_output=True, check=False)
            times = []
            for _ in range(3):
                start = time.perf_counter()
                subprocess.run(command, capture_output=True, check=False)
                times.append(time.perf_counter() - start)
            if median(times) > worst:
                worst, name_of_worst = median(times), name
        label = f"{work} ({name_of_worst})" if name_of_worst else work
        races.append(Race(label, worst, limit, f"{limit:g} s", 1))
    return races
