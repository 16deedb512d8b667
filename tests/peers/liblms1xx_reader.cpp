// Reads scans of a device with libLMS1xx: liblms1xx_reader HOST PORT SCANS. Prints how many values each had, and the values.
#include <cstdio>
#include <cstdlib>
#include <unistd.h>

#include "LMS1xx.h"

int main(int, char **arguments) {
    LMS1xx laser;
    laser.connect(arguments[1], std::atoi(arguments[2]));
    if (!laser.isConnected()) return 1;
    laser.login();
    laser.stopMeas();
    scanCfg scan = laser.getScanCfg();
    std::printf("configuration %d %d %d %d\n", scan.scaningFrequency, scan.angleResolution, scan.startAngle, scan.stopAngle);
    scan.scaningFrequency = 5000;
    scan.angleResolution = 5000;
    laser.setScanCfg(scan);
    scanDataCfg data_cfg = {};
    data_cfg.outputChannel = 1;
    data_cfg.resolution = 1;
    data_cfg.outputInterval = 1;
    laser.setScanDataCfg(data_cfg);
    laser.startMeas();
    for (int tries = 0; laser.queryStatus() != ready_for_measurement; ++tries) {
        if (tries > 300) return 2;
        usleep(100000);
    }
    laser.scanContinous(1);
    for (int number = 0; number < std::atoi(arguments[3]); ++number) {
        static scanData data;
        laser.getData(data);
        std::printf("%d", data.dist_len1);
        for (int beam = 0; beam < data.dist_len1; ++beam) std::printf(" %d", data.dist1[beam]);
        std::printf("\n");
    }
    laser.scanContinous(0);
    laser.stopMeas();
    laser.disconnect();
    return 0;
}
