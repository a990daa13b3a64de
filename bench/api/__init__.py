"""REST and the page: HTTP over the service. asyncio lives here and nowhere else."""
