"""A thread for a node's work: orders first, all of them; then data, of which only the newest wait."""

import threading
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from rclpy.task import Future

from slamgym.core.errors import SlamgymError

MOST_PENDING = 10
"""So many scans wait for the worker; more are left out, the oldest first."""


class _Order(NamedTuple):
    """A piece of work that must be done."""

    work: Callable[[], object]
    kind: str


class Worker:
    """Does a node's work in a thread of its own, so that callbacks return at once.

    Orders (a stop, the end of a goal, a map) are all done, before any data (scans), of which only the newest wait.

    Args:
        wake: Called, from any thread, when the node is to end, or an answer to a service is ready.

    Attributes:
        lock: Held while a piece of work is done.
        most_pending: So many pieces of data wait at most.
        dropped: Pieces of data that were left out because newer ones came faster than they were worked off.
        error: What ended it.
        is_over: The node is to end; no work is begun any more.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self.lock = threading.Lock()
        self.most_pending = MOST_PENDING
        self.dropped = 0
        self.error: Exception | None = None
        self.is_over = False
        self._wake = wake
        self._orders: deque[_Order] = deque()
        self._data: deque[Callable[[], object]] = deque()
        self._has_work = threading.Condition()
        self.start(self._run)

    @property
    def num_pending(self) -> int:
        """Pieces of work that wait."""
        return len(self._orders) + len(self._data)

    def start(self, loop: Callable[[], object]) -> None:
        """Run a loop in a thread; an error in it ends the node, which says it."""

        def run() -> None:
            try:
                loop()
            except Exception as error:  # noqa: BLE001 - run_node raises it
                if not self.is_over:  # else what it publishes with has gone
                    self.error = error
                    self.end()

        threading.Thread(target=run, daemon=True).start()

    def end(self) -> None:
        """End the node, once the callback that runs now has returned."""
        self.is_over = True
        self._wake()

    def put(self, work: Callable[[], object]) -> None:
        """Have data worked off after what is pending; of too much the oldest is left out."""
        with self._has_work:
            if len(self._data) >= self.most_pending:
                self._data.popleft()
                self.dropped += 1
            self._data.append(work)
            self._has_work.notify()

    def order(self, work: Callable[[], object], kind: str = "", *, replaces: bool = False) -> None:
        """Have something done before all data, and after the orders until now.

        Args:
            work: It.
            kind: What it is about.
            replaces: True if orders of its kind that are pending needn't be done any more.
        """
        with self._has_work:
            if replaces:
                self._orders = deque(one for one in self._orders if one.kind != kind)
            self._orders.append(_Order(work, kind))
            self._has_work.notify()

    def forget(self) -> None:
        """Leave out the data that wait."""
        with self._has_work:
            self._data.clear()

    def ask(self, question: Callable[[], str]) -> Future[str]:
        """Order something that has an answer; an error of the user's is the answer's."""
        answer: Future[str] = Future()

        def find() -> None:
            try:
                answer.set_result(question())
            except SlamgymError as error:
                answer.set_exception(error)
            self._wake()

        self.order(find)
        return answer

    def _next(self) -> Callable[[], object]:
        """Take what is to be done now."""
        with self._has_work:
            return self._orders.popleft().work if self._orders else self._data.popleft()

    def _run(self) -> None:
        while True:
            with self._has_work:
                self._has_work.wait_for(lambda: self.num_pending)
            with self.lock:
                if self.is_over:
                    return
                self._next()()
