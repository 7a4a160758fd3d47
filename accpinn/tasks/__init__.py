"""Work in the background: one kind of task, and the queue it waits in.

A training, a comparison of methods and a series of starts are all a `Task`. Each keeps a processor
core busy, so one task runs at a time and the others wait their turn. Whoever asks (a page, many
times a second) gets answers at once and never waits for the worker. A training that was stopped
is continued by submitting the same request again: the store holds its checkpoint.
"""
