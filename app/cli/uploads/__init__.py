"""What ``versant upload`` does with what it is named: one upload each, or the drives of an archive one by one."""
