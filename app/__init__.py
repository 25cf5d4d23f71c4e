"""One driver for both backends, a window, and pictures without one."""
