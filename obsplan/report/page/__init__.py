"""``report.html``: runs played back in a browser, offline."""
