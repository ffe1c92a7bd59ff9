"""What methods that work epoch by epoch share: the log on one clock, levelling, the line through altitudes."""
