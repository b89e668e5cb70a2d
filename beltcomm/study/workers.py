"""Workers that compute the members of a study: this process, processes of this machine (joblib), or a Dask cluster, known only here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar

from beltcomm import isolation
from beltcomm.caches import source_hash
from beltcomm.errors import Refused, UsageError
from beltcomm.talk import Talk

if TYPE_CHECKING:
    from distributed import Client

Given = TypeVar("Given")
Found = TypeVar("Found")
#: Times that workers may die in a row with no result in between, before that is called a cause.
DEATHS = 3
#: s to wait for a scheduler and for its first worker.
SCHEDULER_S, WORKER_S = 10, 30
#: s without an answer after which a cluster is looked at; s without any worker after which that is said, and after which it is the end.
LOOK_S, SAID_S, ALONE_S = 2.0, 6.0, 300.0


def answers(
    function: Callable[[Given], Found],
    given: Sequence[Given],
    *,
    workers: int | None,
    scheduler: str | None,
    talk: Talk,
    alone_s: float = ALONE_S,
) -> Iterator[Found]:
    """Results of ``function`` as they come, in any order; whatever a dead worker had in hand is computed again.

    Parameters
    ----------
    function : callable
        Of one of ``given``.
    given : sequence of Given
        Arguments, one for each call.
    workers : int or None
        Processes of this machine, 1 for this one alone, None for one per processor.
    scheduler : str or None
        Address of a Dask scheduler in their place.
    talk : Talk
    alone_s : float
        So long a cluster may be without any worker.

    Raises
    ------
    UsageError
        For a scheduler that cannot be used.
    Refused
        When workers die again and again, or when a cluster has none any more.
    """
    if scheduler is not None:
        return _on_dask(function, given, scheduler, talk, alone_s)
    count = workers if workers is not None else processors()
    return map(function, given) if count == 1 or len(given) == 1 else _on_processes(function, given, count, talk)


def processors() -> int:
    """Of this machine, as far as this process may use them."""
    from joblib import cpu_count

    return int(cpu_count())


def _number_result(function: Callable[[Given], Found], number: int, given: Given) -> tuple[int, Found]:
    return number, function(given)


def _on_processes(function: Callable[[Given], Found], given: Sequence[Given], workers: int, talk: Talk) -> Iterator[Found]:
    from joblib import Parallel, delayed

    left, deaths = dict(enumerate(given)), 0
    while left:
        tasks = [delayed(_number_result)(function, number, one) for number, one in left.items()]
        try:
            with isolation.children_apart():  # to the end: a worker may be started at any moment
                for number, found in Parallel(n_jobs=workers, backend="loky", batch_size=1, return_as="generator_unordered")(tasks):
                    del left[number]
                    deaths = 0
                    yield found
        except BrokenProcessPool:
            deaths += 1
            if deaths == DEATHS:
                raise Refused(_death_words(deaths, "fewer processes (--workers 1) need less memory")) from None
            talk.say("a worker died; what it had in hand is computed again")


def _on_dask(function: Callable[[Given], Found], given: Sequence[Given], address: str, talk: Talk, alone_s: float) -> Iterator[Found]:
    try:
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise UsageError("a Dask scheduler needs the package distributed: pip install 'beltcomm[study]'") from error

    with _connect(address) as client:
        known = set(client.nthreads())
        done: SimpleQueue[Any] = SimpleQueue()
        submitted = {client.submit(function, one, pure=False) for one in given}
        for future in submitted:
            future.add_done_callback(done.put)
        while submitted:
            try:
                future, found = _next(done, client, address, talk, alone_s, known)
            except KilledWorker as error:
                raise Refused(_death_words(DEATHS, "more memory for the workers may help")) from error
            except (CancelledError, OSError) as error:
                told = " ".join(str(error).split())
                raise Refused(f"the scheduler {address} went away ({told}); what is done is kept, the same command goes on") from error
            yield found
            submitted.remove(future)
            future.release()


def _next(done: SimpleQueue[Any], client: Client, address: str, talk: Talk, alone_s: float, known: set[str]) -> tuple[Any, Any]:
    """The next task that is done, and what it found.   known : workers that have been looked at.

    Raises Refused when the cluster has had no worker for ``alone_s``, or has got one that cannot compute members; OSError without a
    scheduler; what the task raised.
    """
    look_s, without_s, said, future = min(LOOK_S, 0.25 * alone_s), 0.0, False, None
    while True:
        try:
            future = done.get(timeout=look_s) if future is None else future
            found = future.result(timeout=look_s)  # which may have gone with its worker, and is computed again
        except (Empty, TimeoutError):
            threads: dict[str, int] = client.nthreads()
        else:
            if said:
                talk.say("the cluster has workers again; it goes on")
            return future, found
        if new := set(threads) - known:
            _refuse_unfit(client, sorted(new), threads, address)
            known |= new
        if threads:
            if said:
                talk.say("the cluster has workers again; it goes on")
            without_s, said = 0.0, False
            continue
        without_s += look_s
        if without_s >= alone_s:
            raise Refused(
                f"the cluster {address} has had no worker for {alone_s:.3g} s; what is done is kept. Start some with {_alone(address)}, "
                "and the same command goes on"
            )
        if without_s >= min(SAID_S, 0.5 * alone_s) and not said:
            said = True
            talk.say(f"the cluster has no worker any more; it is waited for {alone_s:.3g} s in all. Start some with {_alone(address)}")


def _refuse_unfit(client: Client, new: list[str], threads: Mapping[str, int], address: str) -> None:
    """Raise Refused for a worker that came later and cannot compute members."""
    try:
        programs: dict[str, str] = client.run(source_hash, workers=new)
    except ModuleNotFoundError as error:
        raise Refused(f"a new worker of {address} has no beltcomm ({error}); install the same version there") from error
    except (OSError, KeyError):  # it has gone again
        return
    if said := _unfit(programs, {worker: threads[worker] for worker in programs}, address):
        raise Refused(f"{said}. What is done is kept, the same command goes on")


def _connect(address: str) -> Client:
    """A client with at least one worker that has this beltcomm.   Raises UsageError."""
    from distributed import Client

    try:
        client = Client(address, timeout=SCHEDULER_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise UsageError(
            f"no Dask scheduler answers at {address} ({error}); start one with `dask scheduler`, it prints its address"
        ) from error
    try:
        client.wait_for_workers(1, timeout=WORKER_S)
        programs: dict[str, str] = client.run(source_hash)
        threads: dict[str, int] = client.nthreads()
    except TimeoutError as error:
        client.close()
        raise UsageError(f"the scheduler {address} has no worker; start some with {_alone(address)}") from error
    except ModuleNotFoundError as error:
        client.close()
        raise UsageError(f"a worker of {address} has no beltcomm ({error}); install the same version there") from error
    if said := _unfit(programs, threads, address):
        client.close()
        raise UsageError(said)
    return client


def _unfit(programs: Mapping[str, str], threads: Mapping[str, int], address: str) -> str:
    """Reason why workers cannot compute, by the hash of their beltcomm and their number of threads, empty where they can."""
    others = [worker for worker, program in programs.items() if program != source_hash()]
    if others:
        return f"the worker {others[0]} has another beltcomm than this computer; install the same one there"
    many = [worker for worker, number in threads.items() if number > 1]
    if many:  # a member is made for one thread and the memory of one
        return f"the worker {many[0]} computes in {threads[many[0]]} threads; start it with {_alone(address)}, one for each processor"
    return ""


def _alone(address: str) -> str:
    return f"`dask worker {address} --nthreads 1`"


def _death_words(times: int, hint: str) -> str:
    return f"workers died {times} times in a row over the same members; {hint}. What is done is kept, the same command goes on"
