"""Method ``ukf-dem``: an unscented filter over GNSS, road map and terrain."""
