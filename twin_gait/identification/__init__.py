"""Identification of joint friction from logs and from series of velocity and torque."""
