"""One asyncio loop a file: wait, call a pure function, publish."""
