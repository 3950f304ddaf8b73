"""What can go wrong: `PhysincError`, and beside it the built-in that a caller would expect."""


class PhysincError(Exception):
    """Anything that physinc raises by itself."""


class ConfigError(PhysincError, ValueError):
    """A configuration that can't be: names the key, the value, and what is expected."""


class RecordingError(PhysincError, ValueError):
    """A source that isn't what it should be, or broke."""


class UnknownSourceError(RecordingError):
    """There is no such source, scene or fault, or it takes no such keys: the message says what there is."""


class RecordingNotFoundError(RecordingError, FileNotFoundError):
    """There is no such file."""


class DeviceNotFoundError(PhysincError):
    """No such camera is attached."""


class DevicePermissionError(PhysincError, PermissionError):
    """The device is there, and the system doesn't allow to use it."""


class DeviceBusyError(PhysincError):
    """Another program, or a kernel driver, holds the device."""


class DeviceDisconnectedError(PhysincError, ConnectionError):
    """The device went away."""


class DeviceTimeoutError(PhysincError, TimeoutError):
    """The device doesn't answer, or doesn't get done."""


class DeviceReplyError(PhysincError):
    """The device answers what it shouldn't."""


class StreamTimeoutError(PhysincError, TimeoutError):
    """No input for too long; the stream stays open, and may be asked again."""
