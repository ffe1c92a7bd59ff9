"""What a service's figures become when its map and its evidence grow."""
