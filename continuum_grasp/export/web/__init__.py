"""A scene as a page in which its C runs as WebAssembly."""
