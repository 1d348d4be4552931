import fake_plain
