"""Where the app and the sample recordings, which stand at the top level, go in the package.

All else is in pyproject.toml. An installed package has them as `accpinn/app` and
`accpinn/sample_data`; see `accpinn.storage.shipped`.
"""

from setuptools import find_namespace_packages, find_packages, setup
from setuptools.command.build_py import build_py

PAGES = find_namespace_packages(include=["pages", "pages.*"])


class BuildWithoutThisFile(build_py):
    """The folder of `accpinn.app` is this one, of which it has the app alone."""

    def find_package_modules(self, package: str, package_dir: str) -> list[tuple[str, str, str]]:
        """The modules of a package: its name, theirs, and their files."""
        found = super().find_package_modules(package, package_dir)
        return [part for part in found if part[1] != "setup"]


setup(
    cmdclass={"build_py": BuildWithoutThisFile},
    packages=[
        *find_packages(include=["accpinn*"]),
        "accpinn.app",
        *(f"accpinn.app.{name}" for name in PAGES),
        "accpinn.sample_data",
    ],
    package_dir={
        "accpinn.app": ".",
        "accpinn.app.pages": "pages",
        "accpinn.sample_data": "sample_data",
    },
)
