"""Pages in the browser, by viser: fields, clouds and photographs that follow the mouse."""
