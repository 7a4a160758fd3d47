"""Work in the background: a queue, one worker, and what is known of each task at any moment.

A training (`Job`) and a series of estimations (`Series`) keep a processor core busy, so one task
runs at a time and the others wait their turn. Whoever asks (a page, many times a second) gets
answers at once and never waits for the worker. A training that was stopped is continued by
submitting the same request again: the store holds its checkpoint.
"""
