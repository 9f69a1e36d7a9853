"""The bus between processes of this machine: who may come in, what is lost and what is not."""

import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import structlog

from snakeslam.errors import InputError
from snakeslam.runtime.bus.bus import Bus, BusError
from snakeslam.runtime.bus.link import Certificates, Link, unix_endpoint
from snakeslam.runtime.bus.topics import FRAMES, ROBOT_EVENTS, SERVER_HEARTBEAT, Event, Topic
from snakeslam.runtime.bus.wire import Heartbeat


def wait_for(condition: Callable[[], object], timeout_s: float = 15.0) -> None:
    until = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < until, "it did not happen in time"
        time.sleep(0.01)


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[Bus, Bus]]:
    endpoint = unix_endpoint(tmp_path)
    hub = Bus(Link(endpoint, listens=True))
    node = Bus(Link(endpoint))
    yield hub, node
    node.close()
    hub.close()


def until_heard(hub: Bus, node: Bus, topic: Topic[Event] = ROBOT_EVENTS) -> list[Event]:
    """Publish at the hub until the node hears it; return the list of what it hears."""
    heard: list[Event] = []
    node.subscribe(topic, heard.append)

    def knock() -> bool:
        hub.publish(topic, Event(-1, "info", "knock"))
        return bool(heard)

    wait_for(knock)
    return heard


def test_only_this_user_may_open_the_socket(pair: tuple[Bus, Bus], tmp_path: Path) -> None:
    assert (tmp_path / "bus.sock").stat().st_mode & 0o777 == 0o600


def test_nothing_of_a_lossless_topic_is_lost_and_its_order_stays(pair: tuple[Bus, Bus]) -> None:
    heard = until_heard(*pair)
    for k in range(2000):
        pair[0].publish(ROBOT_EVENTS, Event(k, "info", ""))
    wait_for(lambda: heard[-1].t_ns == 1999)
    assert [event.t_ns for event in heard if event.t_ns >= 0] == list(range(2000))


def test_nodes_that_connect_receive_each_others_messages(pair: tuple[Bus, Bus], tmp_path: Path) -> None:
    third = Bus(Link(unix_endpoint(tmp_path)))
    try:
        assert until_heard(third, pair[1])
    finally:
        third.close()


def test_a_reader_that_sleeps_holds_nobody_up_and_has_the_newest(pair: tuple[Bus, Bus]) -> None:
    hub, node = pair
    until_heard(hub, node)
    heard: list[Heartbeat] = []
    awake = threading.Event()

    def on_heartbeat(heartbeat: Heartbeat) -> None:
        heard.append(heartbeat)
        awake.wait(30.0)

    node.subscribe(SERVER_HEARTBEAT, on_heartbeat)
    wait_for(lambda: hub.publish(SERVER_HEARTBEAT, Heartbeat("x", -1)) or heard)
    for k in range(500):
        hub.publish(SERVER_HEARTBEAT, Heartbeat("x" * 1000, k))
    assert len(heard) == 1, "publishing has waited for the reader"
    awake.set()
    wait_for(lambda: heard[-1].stamp_ns == 499)


def test_nonsense_is_dropped_and_logged_once_and_a_subscriber_that_fails_gets_the_next_message(
    pair: tuple[Bus, Bus], capsys: pytest.CaptureFixture[str]
) -> None:
    hub, node = pair
    heard: list[Event] = []

    def fail_at_first(event: Event) -> None:
        heard.append(event)
        if len(heard) == 1:
            raise RuntimeError("the subscriber is broken")

    node.subscribe(ROBOT_EVENTS, fail_at_first)
    structlog.configure(processors=[structlog.processors.JSONRenderer()], cache_logger_on_first_use=False)
    try:
        wait_for(lambda: hub.publish(ROBOT_EVENTS, Event(0, "info", "")) or len(heard) > 1)
        for data in [b"nonsense"] * 1000 + [b"\0" * (ROBOT_EVENTS.most_bytes + 1)]:
            hub._session.put(f"snakeslam/{ROBOT_EVENTS.name}", data)
        hub.publish(ROBOT_EVENTS, Event(99, "info", "after it"))
        wait_for(lambda: heard[-1].t_ns == 99)
    finally:
        structlog.reset_defaults()
    lines = capsys.readouterr().out.splitlines()
    assert len([line for line in lines if '"message dropped"' in line]) == 1
    assert len([line for line in lines if '"message not handled"' in line]) == 1


def test_a_message_that_cannot_be_sent_does_not_end_its_topic(pair: tuple[Bus, Bus]) -> None:
    hub, node = pair
    heard = until_heard(hub, node)
    hub.publish(ROBOT_EVENTS, Event(1, "info", object()))  # pyright: ignore[reportArgumentType]
    hub.publish(ROBOT_EVENTS, Event(2, "info", "the next"))
    wait_for(lambda: heard[-1].t_ns == 2)


def test_the_link_to_a_hub_that_comes_back_is_opened_again(tmp_path: Path) -> None:
    endpoint = unix_endpoint(tmp_path)
    hub = Bus(Link(endpoint, listens=True))
    node = Bus(Link(endpoint))
    heard = until_heard(hub, node)
    hub.close()
    hub = Bus(Link(endpoint, listens=True))
    count = len(heard)
    try:
        wait_for(lambda: hub.publish(ROBOT_EVENTS, Event(1, "info", "again")) or len(heard) > count)
    finally:
        node.close()
        hub.close()


def test_nobody_there_is_an_error_in_time(tmp_path: Path) -> None:
    with pytest.raises(BusError, match="no node answers"):
        Bus(Link(unix_endpoint(tmp_path)), timeout_s=0.2)
    with pytest.raises(BusError, match="no node answers"):
        Bus(Link(unix_endpoint(tmp_path)), wanted=lambda: False)


@pytest.mark.parametrize("endpoint", ["tcp/0.0.0.0:1", "udp/127.0.0.1:1", "tls/h:1", "", "unixsock-stream/"])
def test_an_endpoint_that_is_open_to_others_is_refused(endpoint: str) -> None:
    with pytest.raises(InputError):
        Link(endpoint)


def test_frames_wait_for_the_link() -> None:
    """A picture is many packets: dropped at the first that finds the link busy, it would never come through."""
    assert FRAMES.bulky


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Certificates]:
    """Certificates by the name of their authority."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl here to make certificates with")
    folder = tmp_path_factory.mktemp("certificates")

    def run(*arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)

    def made(name: str) -> Certificates:
        ca, key, cert = f"{name}-ca.pem", f"{name}-key.pem", f"{name}-cert.pem"
        curve = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-noenc")
        run("req", "-x509", *curve, "-keyout", f"{name}-ca-key.pem", "-out", ca, "-days", "2", "-subj", f"/CN={name}")
        run("req", *curve, "-keyout", key, "-out", f"{name}.csr", "-subj", "/CN=localhost")
        (folder / f"{name}.ext").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\n")
        run("x509", "-req", "-in", f"{name}.csr", "-CA", ca, "-CAkey", f"{name}-ca-key.pem", "-CAcreateserial",
            "-days", "2", "-extfile", f"{name}.ext", "-out", cert)  # fmt: skip
        return Certificates(folder / ca, folder / cert, folder / key)

    return made


def test_across_machines_only_with_a_certificate_of_the_same_authority(
    certificates: Callable[[str], Certificates],
) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tls/localhost:{free.getsockname()[1]}"
    ours, theirs = certificates("ours"), certificates("theirs")
    hub = Bus(Link(endpoint, listens=True, certificates=ours))
    try:
        node = Bus(Link(endpoint, certificates=ours), timeout_s=10.0)
        assert until_heard(hub, node)
        node.close()
        with pytest.raises(BusError):
            Bus(Link(endpoint, certificates=theirs), timeout_s=0.5)
        stranger = Certificates(ours.authority, theirs.certificate, theirs.key)
        with pytest.raises(BusError):
            Bus(Link(endpoint, certificates=stranger), timeout_s=0.5)
    finally:
        hub.close()
