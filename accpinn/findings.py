"""What a computation noticed and a reader should know, as typed data.

Every room defines its own findings beside the code that makes them; `results.messages` turns each
into its sentence. A finding holds numbers, names and vehicle numbers, never prose.
"""

import msgspec


class Finding(msgspec.Struct, frozen=True, tag=True):
    """The base of all findings; a subclass's name is its kind."""
