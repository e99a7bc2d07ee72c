"""The stability of the sampled loop, and the engine as its witness."""
