"""The commands, a file each; those that go together share one."""
