"""Downloads as tasks: how far they are, and that one that was stopped goes on."""

import time
from pathlib import Path

from accpinn.recordings.catalogue import Run
from accpinn.tasks.batches import DownloadTask
from accpinn.tasks.queue import TaskQueue
from accpinn.tasks.task import Status
from tests.support.openacc_files import csv, platoon
from tests.support.publisher import publisher

RUN = Run("Casale", "part2.csv", None)
CONTENT = csv(platoon(2, 1500))


def test_a_download_that_was_stopped_goes_on(tmp_path: Path) -> None:
    queue = TaskQueue(prepare=lambda: None)
    with publisher({RUN.key: CONTENT}, faults={RUN.key: ["stall"]}) as server:
        first = queue.submit(DownloadTask("me", RUN, tmp_path, server.url))
        while not first.latest:
            time.sleep(0.01)
        first.stop()
        assert first.wait(30)
        assert first.status is Status.STOPPED
        assert 0 < first.share < 1
        assert not RUN.path(tmp_path).exists()
        second = queue.submit(DownloadTask("me", RUN, tmp_path, server.url))
        assert second.wait(30)
    assert (second.status, second.share) == (Status.DONE, 1.0)
    assert RUN.path(tmp_path).read_bytes() == CONTENT
    assert server.requests[-1][1].startswith("bytes="), "from where the first one ended"
    queue.close()
