"""Many videos by one command: work cut into tasks that processes or machines do, and that nothing loses."""
