"""The log: nobody who reads it, or no longer, ends nothing."""

import subprocess
import sys

import pytest

SCRIPT = """
import os, sys, structlog
from snakeslam.runtime.process.logs import log_to_stderr
log_to_stderr()
{before}
structlog.get_logger("x").error("a line")
print("still here")
"""


@pytest.mark.parametrize(
    "before", ["os.close(2)", "sys.stderr.close()", "os.dup2(os.open('/dev/full', os.O_WRONLY), 2)"]
)
def test_a_log_that_cannot_be_written_ends_nothing(before: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(before=before)], capture_output=True, text=True, check=False
    )
    assert done.stdout == "still here\n"
