"""The CAN network of the device: its DBC file, and the frames of a run."""
