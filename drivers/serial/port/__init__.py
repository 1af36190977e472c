"""Serial ports: opened, read and written without blocking the event loop; lines cut from bytes."""
