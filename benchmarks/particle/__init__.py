"""What the particle method's speed is compared with: the same epochs by whole arrays; and where its time goes."""
