"""Every kernel on several threads, its gradients too, for ThreadSanitizer: `make sanitize-threads`.

PyTorch itself, whose own threads nothing instruments, keeps to one.
"""

from __future__ import annotations

import sys
from unittest import mock

import torch

from aa4d import _native
from aa4d.stress.precision import subjects, values_and_gradients

THREADS = 4
ANCHORS = 1000


def main() -> None:
    different = []
    for subject in subjects(ANCHORS):
        for arithmetic, kernel in subject.kernels.items():
            by_one = values_and_gradients(kernel, subject.inputs)
            with mock.patch.object(torch, "get_num_threads", return_value=THREADS):
                by_several = values_and_gradients(kernel, subject.inputs)
            pairs = zip([*by_one[0], *by_one[1]], [*by_several[0], *by_several[1]], strict=True)
            if not all(torch.equal(one, several) for one, several in pairs):
                different.append(f"{subject.name} in {arithmetic}")
    print(f"kernels: {len(different)} differ with the number of threads, {_native.worker_count()} workers", *different)
    sys.exit(bool(different))


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
