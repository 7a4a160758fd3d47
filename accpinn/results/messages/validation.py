"""Sentences about the validation of learned parameters on other data."""

from accpinn.evaluation.validation import OtherVehicles, ValidationOverlaps
from accpinn.results.messages import Labelled, message


@message.register
def _(finding: ValidationOverlaps | OtherVehicles, about: Labelled) -> str:
    match finding:
        case ValidationOverlaps():
            return (
                f"The validation window shares {finding.seconds:.0f} s with the one learned from,"
                " so its errors are too small; choose one outside it."
            )
        case OtherVehicles():
            pairs = zip(finding.learned, finding.validated, strict=True)
            unlike = "; ".join(f"{one} by {two}" for one, two in pairs if one != two)
            return (
                f"Other vehicles: {unlike}. The errors then show how far one car's parameters serve"
                " for another."
            )
