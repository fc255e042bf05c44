"""Everything that touches the world; each driver implements a Protocol of app.ports."""
