"""Real parts that several rooms' tests need: drives on links, runs of the emulated drive, real recordings."""
