"""When the packets of the past have been taken."""

from dvs_hinf_controller.running.backlog import Backlog


def test_a_backlog_is_over_when_no_packet_has_followed_the_last():
    backlog = Backlog(0)
    assert not backlog.is_over(100.0)
    for number in range(400):
        backlog.add(1 + 0.0004 * number)
        assert not backlog.is_over(1 + 0.0004 * number)

    assert not backlog.is_over(1.162)
    assert backlog.is_over(1.17)


def test_a_sensor_that_waits_for_no_command_is_answered_after_a_second():
    backlog = Backlog(0)
    for number in range(1000):
        backlog.add(0.001 * number)

    assert not backlog.is_over(0.999)
    assert backlog.is_over(1.001)


def test_a_packet_that_was_published_after_the_start_is_none_of_the_past():
    backlog = Backlog(1000)

    assert backlog.is_of_now(1001, 1500)
    assert not backlog.is_of_now(1000, 1500)
    # By a clock that is ahead, or not at all.
    assert not backlog.is_of_now(1501, 1500)
    assert not backlog.is_of_now(None, 1500)
