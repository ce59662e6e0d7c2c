"""Dask's scheduler and worker without the web server that Dask always starts: it would answer whoever can reach it."""

from __future__ import annotations

from typing import Any

from distributed import Scheduler, Worker


class QuietScheduler(Scheduler):  # type: ignore[misc,unused-ignore]
    """Has a web server only at an address that was asked for."""

    def start_http_server(self, routes: Any, dashboard_address: Any, *args: Any, **given: Any) -> None:
        """Start it, or not."""
        if dashboard_address:
            super().start_http_server(routes, dashboard_address, *args, **given)


class QuietWorker(Worker):  # type: ignore[misc,unused-ignore]
    """Has no web server."""

    def start_http_server(self, *args: Any, **given: Any) -> None:
        """Start none."""
