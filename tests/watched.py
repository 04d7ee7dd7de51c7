"""A page in a browser, watched: what it asks for, and what it complains about."""

DESKTOP, PHONE = {"width": 1280, "height": 900}, {"width": 360, "height": 740}


class Watched:
    """A page, what it asked for, and what it had to complain about."""

    def __init__(self, browser, url, *, offline=True, **options):
        self.context = browser.new_context(offline=offline, viewport=DESKTOP, **options)
        self.page = self.context.new_page()
        self.complaints, self.requests = [], []
        self.page.on("console", self._note)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("dialog", self._dismiss)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(url)

    def _note(self, message):
        # Drawing by software, the browser's own driver remarks on how fast it reads pixels.
        if "GPU stall due to ReadPixels" in message.text:
            return
        if message.type not in ("log", "info", "debug"):
            self.complaints.append(f"{message.type}: {message.text}")

    def _dismiss(self, dialog):
        self.complaints.append(f"a dialog: {dialog.message}")
        dialog.dismiss()
