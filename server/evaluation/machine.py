"""Whether this machine may evaluate: asked by workers, and by the server, which has no simulation of its own."""

from mdrive_sumo import sandbox
from mdrive_sumo.errors import InputError
from mdrive_sumo.suite.engine import check_cluster
from server.settings import Settings

_WAY_OUT = "Give it what is missing (docs/sandbox.md), or demand less by MDRIVE_SANDBOX__REQUIRED=LAYER,LAYER,..."


def check_machine(settings: Settings) -> None:
    """Raises InputError, one sentence, where boxes have fewer layers than the settings demand, or no cluster can be.

    On a cluster agents run elsewhere: there each job looks at the layers.
    """
    if settings.sandbox.backend == "none":
        raise InputError("sandbox: backend: expected bubblewrap or gvisor, found none: a server drives foreign code")
    if settings.work.scheduler:
        check_cluster(settings.work.scheduler)
    else:
        try:
            sandbox.check_layers(settings.sandbox.required)
        except InputError as error:
            raise InputError(f"{error}. {_WAY_OUT}") from None
