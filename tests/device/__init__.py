"""What can only be measured on a GPU: `python -m tests.device`, one command that writes one JSON. See docs/gpu.md."""
