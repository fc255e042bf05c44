"""A quadrotor, a pad, a camera and a MAVLink endpoint that behaves as PX4 does."""
