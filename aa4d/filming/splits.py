"""Which of a capture's frames `--views` names."""

SPLITS = {"all": ("train", "test"), "held-out": ("test",), "training": ("train",)}
