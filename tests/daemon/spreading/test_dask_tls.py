"""A Dask scheduler behind TLS: whoever has a certificate of its authority works, nobody else."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from abbe.daemon.spreading import dask_cluster
from abbe.daemon.spreading.dask_cluster import DaskCluster, SchedulerAddress
from abbe.daemon.spreading.engine import WorkLostError
from abbe.daemon.spreading.spread import SpreadPlace, in_order, spread
from abbe.daemon.spreading.spread_work import SpreadTask
from tests.support.daemon.dask_processes import DaskProcesses, dask_processes
from tests.support.daemon.observed import certificate
from tests.support.daemon.spread_functions import NAME

pytestmark = [
    pytest.mark.integration,
    pytest.mark.xdist_group("dask"),
    pytest.mark.filterwarnings("ignore"),  # Dask's own, about what it finds installed
]
Pem = tuple[Path, Path]


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Pem:
    """A certificate that vouches for itself, and its key: authority and all three sides."""
    return certificate(tmp_path_factory.mktemp("pem"), "own")


@pytest.fixture(scope="module")
def cluster(own: Pem, tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskProcesses]:
    given = ("--tls-ca-file", str(own[0]), "--tls-cert", str(own[0]), "--tls-key", str(own[1]))
    with dask_processes(tmp_path_factory.mktemp("dask"), 1, given) as made:
        assert made.address.startswith("tls://127.0.0.1:")
        yield made


def answers(scheduler: SchedulerAddress) -> list[object]:
    task = partial(SpreadTask, NAME + "reversed_text", "abc")
    return list(in_order(spread([task], SpreadPlace(DaskCluster(scheduler))), 1))


def test_work_is_done_with_the_authority_s_certificate(cluster: DaskProcesses, own: Pem) -> None:
    assert answers(SchedulerAddress(cluster.address, own[0], *own)) == [b"cba"]


@pytest.mark.parametrize("who", ["plain", "stranger", "wrong authority"])
def test_nobody_else_is_let_in(
    who: str,
    cluster: DaskProcesses,
    own: Pem,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dask_cluster, "_CONNECTING", 2.0)
    other = certificate(tmp_path, "other")
    scheduler = {
        "plain": SchedulerAddress(cluster.address.replace("tls://", "tcp://")),
        "stranger": SchedulerAddress(cluster.address, own[0], *other),
        "wrong authority": SchedulerAddress(cluster.address, other[0], *own),
    }[who]
    with pytest.raises(WorkLostError, match=r"no Dask scheduler answers at t[^\n]*$"):
        answers(scheduler)
