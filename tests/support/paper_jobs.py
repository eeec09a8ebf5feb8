"""Jobs as small as can be, for the tests of what runs them."""

import os
import signal
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Counting:
    """Counts up to `steps`, a hundredth of a second each, and writes the numbers: a number twice or none is a mistake.

    trouble   "" for none, "fails" for an error at the beginning, "dies" for a process that is killed half-way, once
    """

    name: str
    steps: int = 20
    trouble: str = ""

    @property
    def forecast(self):
        return 0.01 * self.steps

    def is_done(self, folder):
        return (folder / self.name / "result").is_file()

    def run(self, folder, on_progress):
        own = folder / self.name
        own.mkdir(parents=True, exist_ok=True)
        if self.trouble == "fails":
            raise ValueError("this job fails\nand says more")
        state = own / "state"
        numbers = state.read_text().split() if state.is_file() else []
        try:
            while len(numbers) < self.steps:
                time.sleep(0.01)
                numbers.append(str(len(numbers)))
                if (
                    self.trouble == "dies"
                    and len(numbers) == self.steps // 2
                    and not state.is_file()
                ):
                    state.write_text(" ".join(numbers[:-3]))  # the last ones are lost
                    os.kill(os.getpid(), signal.SIGKILL)
                on_progress(len(numbers) / self.steps)
        except KeyboardInterrupt:
            state.write_text(" ".join(numbers))
            raise
        (own / "result").write_text(" ".join(numbers))
