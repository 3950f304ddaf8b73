"""`physinc reproduce`."""


def reproduce() -> int:
    """Reproduce."""
    return 0
