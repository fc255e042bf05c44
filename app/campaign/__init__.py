"""Many seeded flights of the application in the simulator under virtual time, and what they came to."""
