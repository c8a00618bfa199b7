"""`mdrive-sumo drive`: people drive CAVs of a scenario in the browser."""

import asyncio
import os
import shlex
import signal
import socket
import webbrowser
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from errno import EADDRINUSE
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import click
import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from mdrive_sumo.agents.registry import AGENTS, ASKING_AGENTS, HUMAN_AGENTS
from mdrive_sumo.api.scenario_source import find_scenario
from mdrive_sumo.cli.setting_options import episode_options_without, read_episode_options
from mdrive_sumo.cli.stored_run_options import choose_seed
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.posix import check_posix
from mdrive_sumo.core.suggestion import describe_unknown, shorten_name
from mdrive_sumo.core.terminal import CleanFormatter, echo
from mdrive_sumo.runs.run_config import MAX_SEED
from mdrive_sumo.runs.stored_run import load_viewed_run
from mdrive_sumo.scenario.weather import WEATHERS
from server.drive.access import SeatRole, TokenFilter
from server.drive.drive_app import create_drive_app
from server.drive.drive_file import StoredDrive, load_drive, save_drive
from server.drive.drive_host import DriveHost, make_drive_folder
from server.drive.session_rules import PAUSE, SessionRules
from server.drive.simulation_process import SimulationEnded
from server.drive.simulation_values import DriveSetup

DRIVE_NAME = "drive"
"""Name of the only drive of this server."""
SUBSTITUTES = ("sharing", "single", "sharing+negotiation")
"""Agents that may take over unless others are named: those that need only the sensors on board of a person's car."""
USUAL_PORT = 8420
"""Always the same where it can be: a browser remembers the calibration of a wheel for each address with its port."""
QUIET_S = 1.0
"""Time for which closing takes without a word [s]."""
GRACE_S = 3
"""Time for open responses when the server stops [s]."""
PING_S = 5.0
"""Interval of the WebSocket's own pings, and the time for their answers [s]: who is lost is noticed in 10 s at most."""
MAX_MESSAGE_BYTES = 16 * 1024
"""Largest message of a browser; the longest valid one has some 4 kB."""
MAX_QUEUE = 64
"""Messages of a browser that wait to be read."""
ANY_ADDRESS = ("0.0.0.0", "::")
_SERVER = ("host", "port", "public_url", "no_open", "on_disconnect", "resume")
"""Parameters of the server, which a resumed drive may have anew."""
_ONLY_NEW = ("suite", "cavs", "others", "substitutes", "v2x", "from_run", "tick", "seed", "out", "weather")
"""Parameters that a resumed drive has in its folder."""


@click.command("drive")
@click.argument("scenario", required=False)
@click.option("--suite", metavar="NAME|DIR", help="Where the scenario is [default: a packaged suite].")
@click.option(
    "--cav",
    "cavs",
    multiple=True,
    metavar="NUMBER|ID",
    help="CAV that a person drives, by its number in the scenario or its id; may be repeated [default: 0].",
)
@click.option(
    "--others", metavar="AGENT", help="Built-in agent of the other CAVs [default: sharing; with --from: the run's]."
)
@click.option(
    "--substitute",
    "substitutes",
    multiple=True,
    metavar="AGENT",
    help="Built-in agent that may take over or show what it would do; may be repeated [default: sharing, single,"
    " sharing+negotiation].",
)
@click.option(
    "--v2x", type=click.Choice(["sharing", "off"]), help="What people's CAVs send by themselves [default: sharing]."
)
@click.option("--from", "from_run", type=click.Path(path_type=Path), metavar="RUN", help="Enter an episode of a run.")
@click.option("--tick", type=click.IntRange(0), help="The tick in which it is entered, 20 a second [default: 0].")
@click.option(
    "--seed",
    type=click.IntRange(0, MAX_SEED),
    help="Seed of all randomness [default: 0, the scenario as written; with --from: the run's first].",
)
@episode_options_without("agent_clock")  # people take their own time
@click.option(
    "--weather",
    metavar="|".join(WEATHERS),
    default=None,
    help="What is shown; grip and sensors are those of the scenario's weather [default: that too].",
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", type=click.IntRange(0, 65535), help=f"[default: {USUAL_PORT}, or a free one]")
@click.option(
    "--public-url", metavar="URL", help="How others reach this server, for the links: through a proxy or a tunnel."
)
@click.option("--no-open", is_flag=True, help="Print the links, open nothing.")
@click.option(
    "--on-disconnect",
    metavar="pause|AGENT",
    help="When a driver is lost: wait, or let an agent drive on until the driver is back [default: pause].",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder of the drive [default: runs/...].")
@click.option("--resume", type=click.Path(path_type=Path), metavar="DIR", help="Continue the drive in this folder.")
@click.pass_context
def drive(ctx: click.Context, scenario: str | None, resume: Path | None, **options: Any) -> None:
    """Drive CAVs of SCENARIO yourself, in the browser.

    Prints a link for each driver and one for spectators, and opens the first one. Every take is stored as a run: view,
    verify, rescore, render, explain and export read it. People can pause, go back to any tick and branch there, or let
    an agent drive.

    Ctrl-C ends it; --resume continues it.
    """
    check_posix("drive: the simulation process")
    stored = _resume(ctx, scenario, resume, options) if resume else _start(ctx, scenario, options)
    place = ServerPlace(options["host"], options["port"], options["public_url"])
    asyncio.run(_serve(stored, place, is_browser_wanted=not options["no_open"]))


def _start(ctx: click.Context, scenario: str | None, options: dict[str, Any]) -> StoredDrive:
    """Return the drive that the options ask for. Raises InputError."""
    if scenario is None:
        raise click.UsageError("expected a SCENARIO, found none; `mdrive-sumo list scenarios` shows them")
    from_run: Path | None = options["from_run"]
    if from_run is None and options["tick"] is not None:
        raise click.UsageError("--tick: expected --from RUN with it, found none")
    others = options["others"] or "sharing"
    substitutes = options["substitutes"] or SUBSTITUTES
    on_disconnect = options["on_disconnect"] or PAUSE
    for option, agent in (("--others", others), *(("--substitute", one) for one in substitutes)):
        _check_agent(option, agent)
    if on_disconnect != PAUSE:
        _check_agent("--on-disconnect", on_disconnect, PAUSE)
        substitutes = (*substitutes, on_disconnect)
    episode = read_episode_options(options)
    if from_run is not None and (given := _find_condition(ctx)):
        raise click.UsageError(f"--{given}: expected none with --from, which has the conditions of its run")
    seed = _choose_seed(from_run, options["seed"])
    setup = DriveSetup(
        scenario=scenario,
        folder=make_drive_folder(options["out"], scenario, seed),
        people=_name_cavs(options["cavs"] or ("0",), scenario, options["suite"], from_run),
        suite=options["suite"] or "",
        seed=seed,
        others=others,
        substitutes=tuple(dict.fromkeys(substitutes)),
        v2x=options["v2x"] or "sharing",
        options=episode,
        from_run=from_run,
        from_tick=options["tick"] or 0,
        weather=options["weather"] or "",
    )
    return StoredDrive(setup, SessionRules(on_disconnect=on_disconnect))


def _resume(ctx: click.Context, scenario: str | None, folder: Path, options: dict[str, Any]) -> StoredDrive:
    """Return the drive of a folder. Raises InputError."""
    given = [name for name in _ONLY_NEW if _is_given(ctx, name)]
    if scenario is not None or given or _find_condition(ctx):
        raise click.UsageError("--resume: expected neither SCENARIO nor its options with it: the folder has them")
    stored = load_drive(folder)
    given = options["on_disconnect"]
    agent, choices = given or stored.rules.on_disconnect, (PAUSE, *stored.setup.substitutes)
    if agent != PAUSE:
        _check_agent("--on-disconnect" if given else f"{folder}: on_disconnect", agent, PAUSE)
        if agent not in choices:
            raise InputError(f"--on-disconnect: {describe_unknown(agent, choices)}")
    return StoredDrive(stored.setup, SessionRules(on_disconnect=agent))


def _is_given(ctx: click.Context, name: str) -> bool:
    return ctx.get_parameter_source(name) == click.core.ParameterSource.COMMANDLINE


def _find_condition(ctx: click.Context) -> str:
    """Return the first option of an episode that is on the command line; "" if there is none."""
    names = {parameter.name for parameter in ctx.command.params if parameter.name} - {"scenario", *_SERVER, *_ONLY_NEW}
    return next((name.replace("_", "-") for name in sorted(names) if _is_given(ctx, name)), "")


def _check_agent(option: str, name: str, also: str = "") -> None:
    """Raise InputError unless an agent may drive for a person: built in, without a language model."""
    choices = [one for one in AGENTS if one not in HUMAN_AGENTS and one not in ASKING_AGENTS]
    if name not in choices:
        raise InputError(f"{option}: {describe_unknown(name, [*([also] if also else []), *choices])}")


def _choose_seed(from_run: Path | None, seed: int | None) -> int:
    return (seed or 0) if from_run is None else choose_seed(load_viewed_run(from_run).results, seed)


def _name_cavs(given: Sequence[str], scenario: str, suite: str | None, from_run: Path | None) -> tuple[str, ...]:
    """Return the ids of CAVs that are given by number or id. Raises InputError."""
    if not any(value.isdecimal() for value in given):
        return tuple(given)
    owner = load_viewed_run(from_run).run.suite if from_run is not None else suite
    ids = [ego.id for ego in find_scenario(scenario, owner).scenario.egos]
    return tuple(_name_cav(value, scenario, ids) for value in given)


def _name_cav(value: str, scenario: str, ids: Sequence[str]) -> str:
    if value in ids or not value.isdecimal():
        return value
    if int(value) >= len(ids):
        raise InputError(f"--cav: scenario {scenario}: expected 0 to {len(ids) - 1}, found {value}")
    return ids[int(value)]


# ------------------------------------------------------------------------------------------------------------- server


@dataclass(frozen=True, slots=True)
class ServerPlace:
    """Where the server listens, and how others reach it."""

    host: str
    port: int | None
    """None: the usual one, or a free one if that is taken."""
    public_url: str | None

    def list_names(self) -> list[str]:
        """Return the host names of this server. Raises InputError for a URL that is none."""
        if self.public_url is None:
            return [self.host]
        parts = urlsplit(self.public_url)
        if parts.scheme not in ("http", "https") or not parts.hostname or parts.path.strip("/") or parts.query:
            raise InputError(f"--public-url: expected http(s)://HOST[:PORT], found {shorten_name(self.public_url)}")
        return [self.host, parts.hostname]

    def open_listener(self) -> socket.socket:
        """Return the listening socket. Raises InputError if the address cannot be listened on."""
        try:
            return self._listen(USUAL_PORT if self.port is None else self.port)
        except OSError as error:
            if self.port is None and error.errno == EADDRINUSE:
                echo(f"note: port {USUAL_PORT} is taken; pages remember settings for each port apart", err=True)
                return self._listen(0)
            where = f"{self.host} port {USUAL_PORT if self.port is None else self.port}"
            raise InputError(f"drive: cannot listen on {where}: {_describe(error)}; choose another --port") from None

    def _listen(self, port: int) -> socket.socket:
        family = socket.getaddrinfo(self.host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0][0]
        return socket.create_server((self.host, port), family=family)

    def find_url(self, port: int) -> str:
        """Return the beginning of links."""
        if self.public_url is not None:
            return self.public_url.rstrip("/")
        host = _find_own_address() if self.host in ANY_ADDRESS else self.host
        return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _describe(error: OSError) -> str:
    """Return why, without the address that asyncio and socket repeat; the resolver's numbers are negative."""
    return os.strerror(error.errno) if error.errno is not None and error.errno > 0 else str(error.strerror)


def _find_own_address() -> str:
    """Return an address under which others may reach this machine; that of the machine itself if there is none."""
    with suppress(OSError):
        for *_, address in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET):
            if not str(address[0]).startswith("127."):
                return str(address[0])
    return "127.0.0.1"


async def _serve(stored: StoredDrive, place: ServerPlace, is_browser_wanted: bool) -> None:
    """Serve the drive until a signal ends it."""
    setup = stored.setup
    host = DriveHost(place.list_names())
    with place.open_listener() as listener:
        await _open(host, stored)
        server = DriveServer(make_config(create_drive_app(host)))
        failures: list[str] = []

        def end(_: str, sentence: str) -> None:
            failures.append(sentence)
            server.stop()

        host.on_end = end
        try:
            save_drive(stored)
            url = place.find_url(listener.getsockname()[1])
            server.on_start = lambda: _show_links(host, url, setup.folder, is_browser_wanted)
            await server.serve(sockets=[listener])
        finally:
            await _close(host, server, setup.folder)
    again = f"mdrive-sumo drive --resume {shlex.quote(str(setup.folder))}"
    if failures:
        raise InputError(f"drive: {failures[0]}; continue with: {again}")
    echo(f"stopped; `{again}` continues, `mdrive-sumo view {setup.folder}/takes/N` shows a take", err=True)


async def _open(host: DriveHost, stored: StoredDrive) -> None:
    """Start the simulation. Raises InputError, also for one that ends before it has begun, as without memory."""
    try:
        await host.open_drive(DRIVE_NAME, stored.setup, stored.rules)
    except SimulationEnded:
        raise InputError(
            "drive: the simulation process has ended before the drive began; what it said is above, the system's log"
            " says whether it ran out of memory"
        ) from None


def _show_links(host: DriveHost, url: str, folder: Path, is_browser_wanted: bool) -> None:
    links = host.list_links(DRIVE_NAME)
    for link in links:
        what = f"driver of {link.cav}" if link.role == SeatRole.DRIVER else "spectators"
        echo(f"{what}: {url}{link.path}")
    echo(f"all links: {url}/?token={host.host_token}")
    echo(f"takes: {folder} (Ctrl-C ends the drive)", err=True)
    if is_browser_wanted:
        asyncio.get_running_loop().run_in_executor(None, webbrowser.open, url + links[0].path)


async def _close(host: DriveHost, server: "DriveServer", folder: Path) -> None:
    """End the drive; takes that were left are finished first, unless a second signal comes."""
    closing = asyncio.create_task(host.close())
    done, _ = await asyncio.wait({closing}, timeout=QUIET_S)
    if not done:
        echo(f"finishing the takes in {folder}; Ctrl-C again leaves that to --resume", err=True)
        signalled = asyncio.create_task(server.second_signal.wait())
        await asyncio.wait({closing, signalled}, return_when=asyncio.FIRST_COMPLETED)
        signalled.cancel()
    if not closing.done():
        closing.cancel()
        await host.close(wait_s=0.0)


def make_config(app: FastAPI) -> uvicorn.Config:
    """Return uvicorn's settings for the application of drives."""
    return uvicorn.Config(
        app,
        ws=WebSocketsSansIOProtocol,
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_max_queue=MAX_QUEUE,
        ws_ping_interval=PING_S,
        ws_ping_timeout=PING_S,
        ws_per_message_deflate=False,  # it would cost time, and frames are small
        access_log=False,  # its lines would hold the tokens of links
        log_config=_build_log_config(),
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
    )


def _build_log_config() -> dict[str, Any]:
    """Return settings of logs whose lines hold no token, and nothing that a terminal acts on."""
    return {
        "version": 1,
        "disable_existing_loggers": False,
        "filters": {"tokens": {"()": TokenFilter}},
        "formatters": {"line": {"()": CleanFormatter, "fmt": "%(levelname)s: %(message)s"}},
        "handlers": {"stderr": {"class": "logging.StreamHandler", "formatter": "line", "filters": ["tokens"]}},
        "loggers": {
            name: {"handlers": ["stderr"], "level": "WARNING", "propagate": False} for name in ("uvicorn", "mdrive")
        },
    }


class DriveServer(uvicorn.Server):
    """Ends at the first signal in good order; a second one is noted for those who finish work."""

    on_start: Callable[[], None]

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.second_signal = asyncio.Event()

    @contextmanager
    def capture_signals(self) -> Generator[None]:
        """uvicorn's hook: it would raise the signal again at its end, in the midst of our closing."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self.stop)
        yield

    def stop(self) -> None:
        """Begin to end; called again: note that the user does not want to wait."""
        if self.should_exit:
            self.force_exit = True
            self.second_signal.set()
        self.should_exit = True

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """uvicorn's callback."""
        await super().startup(sockets)
        if self.started:
            self.on_start()
