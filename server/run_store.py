"""What runs leave on disk: a record for each (ID.json) beside its run directory (ID), read again after a restart."""

import contextlib
import os
import re
import secrets
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from server import strict_json
from server.background import note
from snakeslam.claims import Claim, claim, clear_all_dead, clear_dead

RunState = Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
ID = re.compile(r"[0-9a-f]{12}")
OWNER = ".server-"
INTERRUPTED = "its server ended before the run did"
MAX_LISTED = 1000
MAX_ARTIFACTS = 1000


class RunRecord(BaseModel):
    """A run as it is written down; ``owner`` is a folder beside it that its server holds locked."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    id: str
    name: str
    config: str | None
    gait: str | None
    world: str | None
    seed: int | None
    when: str | None
    """UTC, ISO 8601, of the request."""
    request: dict[str, Any] | None = None
    state: RunState = "queued"
    metrics: dict[str, Any] | None = None
    error: str | None = None
    owner: str | None = None


@dataclass(slots=True)
class RunStore:
    """The folder of the API's runs; all methods may be called from any thread."""

    folder: Path
    _claim: Claim | None = None
    _known: dict[str, tuple[tuple[int, int], RunRecord]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def open(self) -> None:
        """Remove what killed servers and runs left unfinished."""
        with contextlib.suppress(OSError):
            clear_all_dead(self.folder, f"{OWNER}*")
            clear_all_dead(self.folder, ".*.part")

    def close(self) -> None:
        """Release the folder."""
        if self._claim is not None:
            self._claim.remove()

    def save(self, record: RunRecord) -> None:
        """Write a record down as this server's; the file is replaced at once. OSError when it cannot be."""
        self.folder.mkdir(parents=True, exist_ok=True)
        while self._claim is None:
            self._claim = claim(self.folder / f"{OWNER}{secrets.token_hex(6)}", 0o700)
        text = record.model_copy(update={"owner": self._claim.path.name}).model_dump_json(indent=1)
        part = self.folder / f".{record.id}.json.part"
        part.write_text(text + "\n", encoding="utf-8")
        part.replace(self.folder / f"{record.id}.json")

    def artifacts(self, run_id: str) -> dict[str, Path]:
        """Return the files of a run directory by name; nothing where there is none."""
        try:
            with os.scandir(self.folder / run_id) as entries:
                files = [Path(e.path) for e in entries if e.is_file(follow_symlinks=False) and e.name.isprintable()]
        except OSError:
            return {}
        return {path.name: path for path in sorted(files)[:MAX_ARTIFACTS] if os.access(path, os.R_OK)}

    def load(self) -> list[RunRecord]:
        """Return what lies on disk, the newest MAX_LISTED, oldest first; what cannot be read is left out."""
        with self._lock:
            try:
                stamps = self._stamps()
            except OSError:
                return []
            self._known = {run_id: found for run_id, found in self._known.items() if run_id in stamps}
            for run_id in sorted(stamps, key=lambda run_id: stamps[run_id])[-MAX_LISTED:]:
                self._refresh(run_id, stamps[run_id])
            found = [record for _, record in self._known.values()]
        return sorted(map(self._judged, found), key=lambda record: (record.when or "", record.id))

    def _stamps(self) -> dict[str, tuple[int, int]]:
        """Return time and size of every record, or of the run directory that has none."""
        found: dict[str, tuple[int, int]] = {}
        with os.scandir(self.folder) as entries:
            for entry in entries:
                run_id, is_record = entry.name.removesuffix(".json"), entry.name.endswith(".json")
                if not ID.fullmatch(run_id) or entry.is_symlink() or (is_record != entry.is_file()):
                    continue
                with contextlib.suppress(OSError):
                    stat = entry.stat(follow_symlinks=False)
                    if is_record or run_id not in found:
                        found[run_id] = stat.st_mtime_ns, stat.st_size
        return found

    def _refresh(self, run_id: str, stamp: tuple[int, int]) -> None:
        if run_id in self._known and self._known[run_id][0] == stamp:
            return
        try:
            record = self._read(run_id)
        except (OSError, ValueError) as error:
            note(f"reading run {run_id}", error)
            record = RunRecord(
                id=run_id, name=run_id, config=None, gait=None, world=None, seed=None, when=None,
                state="failed", error="its files cannot be read",
            )  # fmt: skip
        self._known[run_id] = stamp, record

    def _read(self, run_id: str) -> RunRecord:
        path = self.folder / f"{run_id}.json"
        if path.exists():
            record = _valid(RunRecord, strict_json.read(path))
            if record.id != run_id:
                raise ValueError(f"the record is that of {record.id[:40]!r}")
            return record
        return record_of_facts(run_id, strict_json.read(self.folder / run_id / "run.json"))

    def _judged(self, record: RunRecord) -> RunRecord:
        """Return a record as it is now: a run whose server has died is done or interrupted."""
        if record.state not in ("queued", "running"):
            return record
        owner = record.owner or ""
        if re.fullmatch(rf"\{OWNER}[0-9a-f]+", owner) and not clear_dead(self.folder / owner):
            return record
        try:
            facts = record_of_facts(record.id, strict_json.read(self.folder / record.id / "run.json"))
        except (OSError, ValueError):
            return record.model_copy(update={"state": "interrupted", "error": INTERRUPTED})
        return record.model_copy(update={"state": "done", "metrics": facts.metrics})


def _valid(kind: type[RunRecord], value: object) -> RunRecord:
    try:
        return kind.model_validate(value, strict=True)
    except ValidationError as error:
        raise ValueError(f"{error.errors()[0]['loc']}: {error.errors()[0]['msg']}") from error


def record_of_facts(run_id: str, facts: object) -> RunRecord:
    """Return the record of a finished run directory from its run.json; ValueError when it is none."""
    try:
        assert isinstance(facts, dict)
        config = facts["config"]
        gait, world, seed = config["gait"]["name"], config["sim"]["world"], facts["seed"]
        values = {"id": run_id, "name": f"{gait}-s{seed}", "config": None, "gait": gait, "world": world, "seed": seed}
        return _valid(RunRecord, {**values, "when": facts["written"], "state": "done", "metrics": facts["metrics"]})
    except (AssertionError, KeyError, TypeError) as error:
        raise ValueError("run.json has another form") from error
