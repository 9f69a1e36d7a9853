"""A real server around a fake robot: ``python -m tests.server.serve_still PORT HOST [RECORDINGS]``.

With $SNAKESLAM_TEST_BUS the robot's nodes are met there. $SNAKESLAM_TEST_SEED says how the robot behaves (still_robot).
"""

import os
import sys
from pathlib import Path


def main() -> int:
    # The session's process imports this module too, and needs none of these.
    from server.main import serve
    from snakeslam.config import Config, RunSettings
    from snakeslam.errors import SnakeslamError
    from snakeslam.robot.model import RobotSettings
    from snakeslam.runtime.assembly.spec import SessionSpec
    from snakeslam.runtime.bus.link import Link
    from tests.server.still_robot import still_robot

    port, host, *folders = sys.argv[1:]
    seed = int(os.environ.get("SNAKESLAM_TEST_SEED", "1"))
    config = Config(robot=RobotSettings(model="orthogonal24"), run=RunSettings(seed=seed))
    bus = os.environ.get("SNAKESLAM_TEST_BUS")
    spec = SessionSpec(config, build=still_robot, link=None if bus is None else Link(bus))
    try:
        serve(config, host=host, port=int(port), recordings=[Path(folder) for folder in folders], spec=spec)
    except SnakeslamError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
