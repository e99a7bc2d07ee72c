"""The CAN network of the device: its DBC file, and frames of what a walk does."""
