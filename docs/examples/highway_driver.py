"""A machine for a study: a simulated car on a motorway, driven in the style that is asked for.

The car follows the intelligent driver model and changes lanes by MOBIL, as highway-env has them.
A study chooses its time gap (s), politeness (0: only its own gain counts) and comfortable
acceleration (m/s^2). One run writes one video:

    python highway_driver.py --gap 1.5 --politeness 0.2 --acceleration 3 --seed 1 --out drive.mp4

It needs: pip install highway-env av
"""

import argparse
import sys

import av
import gymnasium
import highway_env  # noqa: F401, registers its environments with gymnasium
from highway_env.vehicle.behavior import IDMVehicle

FRAMES_PER_SECOND = 15
WIDTH_PX, HEIGHT_PX = 640, 180
CRASHED = 3  # the exit status by which a machine says: never run these parameters


class Drive:
    """One drive. pictures() yields arrays (180, 640, 3); crashed says afterwards how it ended."""

    def __init__(self, gap, politeness, acceleration, seed):
        self.environment = gymnasium.make(
            "highway-v0",
            render_mode="rgb_array",
            config={
                "offscreen_rendering": True,
                "screen_width": WIDTH_PX,
                "screen_height": HEIGHT_PX,
                "vehicles_count": 30,
                "vehicles_density": 1.3,
            },
        ).unwrapped
        # The same seed has the same traffic, whatever the style.
        self.environment.reset(seed=seed)
        self.car = IDMVehicle.create_from(self.environment.vehicle)
        self.car.TIME_WANTED = gap
        self.car.POLITENESS = politeness
        self.car.COMFORT_ACC_MAX = acceleration
        self.car.target_speed = 30.0  # m/s, faster than the traffic
        self.car.color = (200, 60, 30)
        vehicles = self.environment.road.vehicles
        vehicles[vehicles.index(self.environment.vehicle)] = self.car
        self.environment.controlled_vehicles = [self.car]

    @property
    def crashed(self):
        """Whether the car has hit another."""
        return self.car.crashed

    def pictures(self, count):
        """Drive on for so many pictures, or until a crash."""
        for _ in range(count):
            self.environment.road.act()
            self.environment.road.step(1 / FRAMES_PER_SECOND)
            yield self.environment.render()
            if self.crashed:
                return


def main():
    """Drive once, write the video and print how far it is."""
    parser = argparse.ArgumentParser(description="Drive once and write a video.")
    parser.add_argument("--gap", type=float, required=True, help="time gap in s")
    parser.add_argument("--politeness", type=float, required=True)
    parser.add_argument("--acceleration", type=float, required=True, help="in m/s^2")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--out", required=True, help="video to write, such as drive.mp4")
    asked = parser.parse_args()
    drive = Drive(asked.gap, asked.politeness, asked.acceleration, asked.seed % 2**32)
    count = round(asked.seconds * FRAMES_PER_SECOND)
    with av.open(asked.out, "w", format="mp4") as file:
        stream = file.add_stream("libx264", rate=FRAMES_PER_SECOND)
        stream.width, stream.height, stream.pix_fmt = WIDTH_PX, HEIGHT_PX, "yuv420p"
        for number, picture in enumerate(drive.pictures(count), start=1):
            file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            print(f"pbpo: progress {number / count:.2f}", flush=True)
        file.mux(stream.encode())
    if drive.crashed:
        print("the car crashed", file=sys.stderr)
        return CRASHED
    return 0


if __name__ == "__main__":
    sys.exit(main())
