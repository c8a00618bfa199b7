// The motion of a whole take, kept in the browser, so that any tick is shown at once.
