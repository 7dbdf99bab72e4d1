"""Objects that live while the add-on is registered: the work in progress and the pictures. Nothing of them survives `clear`."""

_live = {}


def start(work, pictures):
    _live.update(work=work, pictures=pictures)


def work():
    return _live["work"]


def pictures():
    return _live["pictures"]


def clear():
    _live.clear()
