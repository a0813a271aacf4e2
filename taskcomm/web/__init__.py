"""The simulator and the study in the browser: server, pages, bots. Needs `pip install 'taskcomm[web]'`."""
