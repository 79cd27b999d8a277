"""How frames and work change threads: bounded queues that count what they hold and what they lose."""
