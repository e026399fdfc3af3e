"""Which problems are logged when."""

from esfo_ros.reminder import Reminder


def test_problems_are_told_when_they_begin_and_now_and_then_while_they_last():
    now = [0.0]
    reminder = Reminder(10.0, lambda: now[0])

    def due(seconds, *kinds):
        now[0] = seconds
        return reminder.due(frozenset(kinds))

    assert not due(0.0)
    assert due(1.0, "lost")
    assert not due(2.0, "lost")
    assert due(3.0, "lost", "late")
    assert not due(12.9, "lost", "late")
    assert due(13.1, "lost", "late")
    assert not due(14.0, "lost")
    assert not due(15.0)
    assert due(16.0, "lost")
